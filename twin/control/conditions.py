"""Conditions: errors of an episode's vehicle and water, besides the start that its task samples.

The argument `randomise` of an environment gives new conditions to every episode. It is an object
with a method `draw`, a registered randomiser's name, or distributions by parameter.
A plugin adds its own type under the entry-point group `glider_twin.randomisers`. The sampled
conditions are written into a MuJoCo model here, and its vehicle is put at its start.
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
"""TABLE: randomiser that a mapping gets by default. BASE: key that names another randomiser."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Conditions:
    """Vehicle and water of one episode; None keeps the vehicle file's or the task's value."""

    vehicle: Vehicle | None = None
    """Vehicle that is flown; the task, its policy and the trims use the vehicle of the file."""
    ballast: Ballast | None = None
    """Ballasting of the vehicle."""
    encoder_zeros: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Positions of parts whose encoders read 0, by name, in the parts' units."""
    current: Current | None = None
    """Current that is added to the task's sampled current."""
    origin: Origin | None = None
    """Place for which the current is compiled; None: `Origin()`."""
    density: DensityProfile | None = None
    """Density of the water; None: the reference density."""

    @property
    def only_current(self) -> bool:
        """True if vehicle and density are those of the files."""
        real = self.vehicle is not None or self.ballast is not None or bool(self.encoder_zeros)
        return not real and self.density is None

    def flowing(self, current: Current | None) -> Conditions:
        """Copy of the conditions with another current added."""
        both = [part for part in (self.current, current) if part is not None]
        total = CurrentSum(parts=tuple(both)) if len(both) > 1 else next(iter(both), None)
        return dataclasses.replace(self, current=total)


class Randomiser(Protocol):
    """Interface of objects that sample the conditions of episodes."""

    def draw(self, random: np.random.RandomState) -> Conditions:
        """Sample the conditions of one episode from its own random numbers."""


Maker = Callable[..., Randomiser]
"""Function that makes a randomiser from a mapping of distributions by parameter, with the
keywords vehicle, depth [m] (the task's limit) and duration [s] of an episode."""


def check_randomiser(name: str, kind: Any) -> Maker:
    """Return the function; raises InputError if it is not callable."""
    if not callable(kind):
        raise InputError(
            f"randomiser {name!r} is only half there: {kind!r} must be a function that makes one"
        )
    made: Maker = kind
    return made


RANDOMISERS: Registry[Maker] = seams.RANDOMISERS
"""Functions that make randomisers, by name."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeConditions:
    """Constant current plus the conditions of a randomiser."""

    current: Current | None
    randomiser: Randomiser | None

    def draw(self, random: np.random.RandomState) -> Conditions:
        """Sample the conditions of one episode; see `Randomiser`."""
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
    """Make the sampler of an environment's conditions; None if nothing is requested.

    Args:
      current: current, or its text as for `twin.parse_current`.
      randomise: object with `draw`, a registered name, or a mapping of distributions.
      depth: [m] depth limit of the task. duration: [s] of an episode.

    Raises:
      InputError: episodes without a time limit, or invalid settings.
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
"""Fields of a model, besides the block, that differ between real vehicles."""


class Nominal:
    """Nominal values of everything in a model that conditions change."""

    def __init__(self, model: mujoco.MjModel):
        """Copy the values of a model that has no water of its own yet."""
        self._model = model
        self._values = {
            name: getattr(model, name).copy() for name in ("numeric_data", *OF_THE_VEHICLE)
        }

    def restore(self) -> None:
        """Write the nominal values back into the model."""
        for name, values in self._values.items():
            getattr(self._model, name)[...] = values


def write_conditions(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    vehicle: Vehicle,
    conditions: Conditions,
    duration: float,
) -> None:
    """Write vehicle and water of an episode of `duration` [s] into a model as compiled.

    `data` belong to the model and are overwritten.

    Raises:
      InputError: the water exceeds the model's room. VehicleError: the vehicle needs a model of
        its own.
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
    """Compile the water of an episode of `duration` [s] around the real vehicle."""
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
    """Write a start into freshly reset data, relative to the current that the model carries.

    The start belongs to the file's vehicle; the errors of the flown vehicle act from then on.
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
