"""Conditions: the real vehicle and the water of an episode, which a task does not draw itself.

`randomise` of an environment draws them anew for every episode. It is an object with a method
`draw`, or the settings of a registered one: a name, or a mapping from parameters to distributions.
A distribution of one's own brings a kind under the entry-point group `glider_twin.randomisers`.
What is drawn is written here into a model of MuJoCo, whose vehicle is put at its start.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import mujoco
import numpy as np

from twin import seams
from twin.errors import InputError
from twin.physics.condition import apply_real_vehicle, set_start, stagger
from twin.physics.model_block import Tables, header, room, table, write_tables
from twin.physics.mujoco_model import refit
from twin.physics.native.install import install
from twin.physics.start import Ballast, Start
from twin.registry import Registry
from twin.vehicle.vehicle import Vehicle
from twin.water.current.axes import Origin
from twin.water.current.base import Current, CurrentSum, parse_current
from twin.water.current.sampler import sample
from twin.water.density import DensityProfile

TABLE, BASE = "table", "preset"
"""The randomiser of a mapping that names none, and the key under which it names one"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Conditions:
    """Vehicle and water of one episode; None is as the vehicle file and the task say."""

    vehicle: Vehicle | None = None
    """The vehicle as it is; the task, its pilot and the trims keep to the one of the file."""
    ballast: Ballast | None = None
    """How it was weighed."""
    encoder_zeros: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Where parts are when their encoders say 0, by name, in the parts' units."""
    current: Current | None = None
    """It is added to what the task draws itself."""
    origin: Origin | None = None
    """Place that the current is compiled for; None is `Origin()`."""
    density: DensityProfile | None = None
    """Density of the water; None is the reference density."""

    @property
    def only_current(self) -> bool:
        """Whether vehicle and density are as the files say."""
        real = self.vehicle is not None or self.ballast is not None or bool(self.encoder_zeros)
        return not real and self.density is None

    def flowing(self, current: Current | None) -> Conditions:
        """With another current added."""
        both = [part for part in (self.current, current) if part is not None]
        total = CurrentSum(parts=tuple(both)) if len(both) > 1 else next(iter(both), None)
        return dataclasses.replace(self, current=total)


class Randomiser(Protocol):
    """Draws the conditions of episodes."""

    def draw(self, random: np.random.RandomState) -> Conditions:
        """The conditions of one episode, from its own random numbers."""


Maker = Callable[..., Randomiser]
"""Takes a mapping of distributions by parameter, and as keywords vehicle, depth [m] (the task's
limit) and duration [s] of an episode"""


def check_randomiser(name: str, kind: Any) -> Maker:
    """The function; raises InputError when it is none."""
    if not callable(kind):
        raise InputError(
            f"randomiser {name!r} is only half there: {kind!r} must be a function that makes one"
        )
    made: Maker = kind
    return made


RANDOMISERS: Registry[Maker] = seams.RANDOMISERS
"""The functions that make randomisers, by name."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeConditions:
    """A constant current, and what a randomiser draws."""

    current: Current | None
    randomiser: Randomiser | None

    def draw(self, random: np.random.RandomState) -> Conditions:
        """See `Randomiser`."""
        drawn = Conditions() if self.randomiser is None else self.randomiser.draw(random)
        return drawn.flowing(self.current)


def conditions_of(
    current: Current | str | None,
    randomise: Randomiser | str | Mapping[str, Any] | None,
    *,
    vehicle: Vehicle,
    depth: float,
    duration: float,
) -> EpisodeConditions | None:
    """What draws an environment's conditions; None where nothing is asked for.

    Args:
      current: or its text, as `twin.parse_current` takes it.
      randomise: an object that draws, a registered name, or a mapping of distributions.
      depth: [m] down to which the task goes. duration: [s] of an episode.

    Raises:
      InputError: episodes without an end, or settings that cannot be used.
    """
    if current is None and randomise is None:
        return None
    if not np.isfinite(duration):
        raise InputError(
            "current and randomise need a time limit: water is compiled for an episode"
        )
    if isinstance(current, str):
        current = parse_current(current)
    if isinstance(randomise, str):
        randomise = {BASE: randomise}
    if isinstance(randomise, Mapping):
        changes = dict(randomise)
        maker = RANDOMISERS[str(changes.pop(BASE, TABLE))]
        randomise = maker(changes, vehicle=vehicle, depth=depth, duration=duration)
    if not (randomise is None or hasattr(randomise, "draw")):
        raise InputError(
            f"randomise {randomise!r}: give a name, a mapping of distributions or an object with "
            "draw(random)"
        )
    return EpisodeConditions(current=current, randomiser=randomise)


OF_THE_VEHICLE = ("qpos0", "body_ipos", "dof_invweight0", "dof_M0", "body_invweight0")
"""Fields of a model beside the block that a real vehicle has of its own"""


class Nominal:
    """What conditions change in a model, as it was compiled."""

    def __init__(self, model: mujoco.MjModel):
        """Remember a model that has no water of its own yet."""
        self._model = model
        self._values = {
            name: getattr(model, name).copy() for name in ("numeric_data", *OF_THE_VEHICLE)
        }

    def restore(self) -> None:
        """Make the model so again."""
        for name, values in self._values.items():
            getattr(self._model, name)[...] = values


def write_conditions(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    vehicle: Vehicle,
    conditions: Conditions,
    duration: float,
) -> None:
    """Put the vehicle and the water of an episode of `duration` [s] into a model as compiled.

    `data` are the model's and are overwritten.

    Raises:
      InputError: the water takes more room than the model has. VehicleError: a vehicle that needs
        a model of its own.
    """
    real = conditions.vehicle
    if real is not None:
        refit(model, data, vehicle, real)
    tables = water_of(conditions, real or vehicle, duration)
    if tables.words > room(model):
        raise InputError(
            f"the water of an episode takes {tables.words} numbers, the model has room for "
            f"{room(model)}: draw a coarser current, or shorten the episodes"
        )
    write_tables(model, tables)
    install(current=tables.current.size > 0)


def water_of(conditions: Conditions, vehicle: Vehicle, duration: float) -> Tables:
    """The water of an episode of `duration` [s] around the real vehicle."""
    current, density, nothing = conditions.current, conditions.density, np.zeros(0)
    if density is None:
        tables = Tables()
    else:
        warm = density.compile_temperature() if vehicle.hull_thermal_expansion else nothing
        tables = Tables(density=density.compile(), temperature=warm)
    if current is None:
        return tables
    return tables._replace(current=current.compile(duration, conditions.origin))


def place_vehicle(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    start: Start,
    vehicle: Vehicle | None = None,
    conditions: Conditions | None = None,
) -> None:
    """Write a start into data that were reset, with the water that the model carries.

    The start is the vehicle's of the file; the errors of a real one act from there on.
    """
    program, water = table(model, "current"), np.zeros(3)
    if program.size:
        at = (data.time, start.north, start.east, start.depth, 0.0, 0.0, 0.0)
        water = np.array(sample(program, *at)[:3])
    data.userdata[:] = 0.0
    set_start(model, data, start, water)
    if header(model)["centred"]:
        stagger(model, data)
    if conditions is not None and vehicle is not None:
        apply_real_vehicle(
            model,
            conditions.vehicle or vehicle,
            ballast=conditions.ballast,
            density=conditions.density,
            encoder_zeros=conditions.encoder_zeros,
        )
