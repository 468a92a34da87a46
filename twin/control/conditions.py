"""Conditions: the real vehicle and the water of an episode, which a task does not draw itself.

`randomise` of an environment draws them anew for every episode. It is an object with a method
`draw`, or the settings of a registered one: a name, or a mapping from parameters to distributions.
A distribution of one's own brings a kind under the entry-point group `glider_twin.randomisers`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from twin import seams
from twin.errors import InputError
from twin.physics.start import Ballast
from twin.registry import Registry
from twin.vehicle.vehicle import Vehicle
from twin.water.current.axes import Origin
from twin.water.current.base import Current, CurrentSum
from twin.water.current.current_text import parse_current
from twin.water.density import DensityProfile

TABLE, BASE = "table", "preset"
"""The randomiser of a mapping that names none, and the key under which it names one"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Conditions:
    """Of one episode; what is None is as the vehicle file and the task say."""

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
    """Of the water, None is the reference density."""

    @property
    def only_current(self) -> bool:
        """Whether vehicle and density are as the files say."""
        real = self.vehicle is not None or self.ballast is not None or bool(self.encoder_zeros)
        return not real and self.density is None

    def flowing(self, current: Current | None) -> Conditions:
        """With another current added."""
        both = [part for part in (self.current, current) if part is not None]
        if len(both) > 1:
            return dataclasses.replace(self, current=CurrentSum(parts=tuple(both)))
        return dataclasses.replace(self, current=both[0] if both else None)


class Randomiser(Protocol):
    """Draws the conditions of episodes."""

    def draw(self, random: np.random.RandomState) -> Conditions:
        """Those of one episode, from its own random numbers."""


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
