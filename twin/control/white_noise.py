"""White noise of observations: a number that depends on seed, episode, step and place alone.

So one vehicle's noise is the same alone and among any number of others. The numbers are made by
hashing, with SplitMix64 (Steele, Lea and Flood 2014, Fast splittable pseudorandom number
generators, OOPSLA), and shaped by Box and Muller's transform. Goals are worked out from the same
noisy numbers that are shown, so that no observation tells what another one hides.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.numbers import Array

Words = NDArray[np.uint64]
Counts = NDArray[np.int64]

UNSHOWN = {"heading": 1, "position": 2}
"""Measurements behind goals that are no observations themselves, and how many numbers each has:
heading [rad]; north and east [m]."""


class Noisy:
    """Measurements plus errors; each is shaped as that of the physics, of one vehicle or many."""

    def __init__(self, seen: Any, errors: Mapping[str, Array]):
        """Put errors on what is `seen`.

        Args:
          seen: a Physics, a ManyPhysics or a Believed.
          errors: by the names of `GliderTask.observe_vehicle` and of UNSHOWN, in their units, shape
            (numbers,) or (vehicles, numbers). What is not named has none.
        """
        self._seen, self._errors = seen, errors

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise InputError(
            f"noise: a goal of this task is made of physics.{name}, which has no noisy form: work "
            f"the goal out from {', '.join(sorted(_MEASURED))}"
        )

    def _one(self, name: str, part: int = 0) -> Any:
        """The error of one number of a measurement."""
        errors = self._errors.get(name)
        return 0.0 if errors is None else errors[..., part]

    def time(self) -> Any:
        """[s], without an error."""
        return self._seen.time()

    def roll(self) -> Any:
        """[rad]"""
        return self._seen.roll() + self._one("attitude", 0)

    def pitch(self) -> Any:
        """[rad]"""
        return self._seen.pitch() + self._one("attitude", 1)

    def heading(self) -> Any:
        """[rad] in [0, 2 pi)"""
        return (self._seen.heading() + self._one("heading")) % (2.0 * np.pi)

    def rates(self) -> Array:
        """Roll, pitch, yaw rate [rad/s], (..., 3)."""
        return np.asarray(self._seen.rates() + self._errors.get("rates", 0.0))

    def velocity_through_water(self) -> Array:
        """Surge, sway, heave [m/s], (..., 3)."""
        return np.asarray(self._seen.velocity_through_water() + self._errors.get("velocity", 0.0))

    def surge(self) -> Any:
        """[m/s] through the water."""
        return self.velocity_through_water()[..., 0]

    def speed(self) -> Any:
        """[m/s] through the water."""
        return np.linalg.norm(self.velocity_through_water(), axis=-1)

    def depth(self) -> Any:
        """[m]"""
        return self._seen.depth() + self._one("depth")

    def depth_rate(self) -> Any:
        """[m/s]"""
        return self._seen.depth_rate() + self._one("depth_rate")

    def actuators(self) -> Array:
        """Positions of the parts as fractions of their travel, (..., parts)."""
        return np.asarray(self._seen.actuators() + self._errors.get("actuators", 0.0))

    def net_buoyancy(self) -> Any:
        """[kg], + = heavy."""
        return self._seen.net_buoyancy() + self._one("net_buoyancy")

    def north(self) -> Any:
        """[m]"""
        return self._seen.north() + self._one("position", 0)

    def east(self) -> Any:
        """[m]"""
        return self._seen.east() + self._one("position", 1)

    def current(self) -> Array:
        """Of the water, NED [m/s], (..., 3), without an error of its own."""
        return np.asarray(self._seen.current())


_MEASURED = [name for name in vars(Noisy) if not name.startswith("_")]


_GAMMA, _ONE, _TWO = (np.uint64(value) for value in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9,
                                                      0x94D049BB133111EB))  # fmt: skip


def _mixed(words: Words) -> Words:
    """SplitMix64's next number of each state."""
    words = words + _GAMMA
    words = (words ^ (words >> np.uint64(30))) * _ONE
    words = (words ^ (words >> np.uint64(27))) * _TWO
    return words ^ (words >> np.uint64(31))


LARGEST = 13.0
"""Deviations that an error never reaches: radii end at sqrt(108 ln 2) = 8.7 of them, and a pair of
numbers, turned into other axes, at sqrt(2) times that."""


def normal(seed: Counts, episode: Counts, step: Counts, width: int) -> Array:
    """Standard normal numbers of vehicles, shape (vehicles, width).

    Args:
      seed, episode, step: whole numbers, one of each for every vehicle, shape (vehicles,).
    """
    with np.errstate(over="ignore"):
        state = np.zeros(len(seed), np.uint64)
        for part in (seed, episode, step):
            state = _mixed(state ^ np.asarray(part).astype(np.uint64))
        places = state[:, None] + np.arange(2 * width, dtype=np.uint64) * _GAMMA
        bits = _mixed(places) >> np.uint64(11)
    uniform = (bits.astype(np.float64) + 0.5) * 2.0**-53
    radius = np.sqrt(-2.0 * np.log(uniform[:, :width]))
    return np.asarray(radius * np.cos(2.0 * np.pi * uniform[:, width:]))


class Noise:
    """White noise of what a task's observations are made of.

    The vehicle's own observations get it where they are measured, so goals made of them follow:
    with noise of the depth, the depth shown and the metres to go add up to the target. Heading and
    position, which goals are made of and no observation shows, have noise by these names. Noise of
    a goal's own name is added to the goal. Rewards and ends of episodes keep to the truth.
    """

    def __init__(
        self,
        noise: Mapping[str, float] | None,
        goals_from: Mapping[str, tuple[str, ...]],
        widths: Mapping[str, int],
    ):
        """Standard deviations by name, in its unit.

        Args:
          goals_from: of the task, what its goals are made of; see `GliderTask.goals_from`.
          widths: numbers of each observation, by name.

        Raises:
          InputError: no such observation, or a deviation that is negative or not finite.
        """
        behind = {name for made_of in goals_from.values() for name in made_of}
        unshown = {name: width for name, width in UNSHOWN.items() if name in behind}
        self.deviations = dict(noise or {})
        self._first: dict[str, slice] = {}
        self._width = 0
        for name, width in {**widths, **unshown}.items():
            self._first[name] = slice(self._width, self._width + width)
            self._width += width
        for name, deviation in self.deviations.items():
            if name not in self._first:
                raise InputError(unknown_name("observation of this task", name, self._first))
            if not (np.isfinite(deviation) and deviation >= 0.0):
                raise InputError(f"noise of {name} is {deviation!r}: give 0 or more")

    def draw(self, seed: Counts, episode: Counts, step: Counts) -> dict[str, Array]:
        """Errors by name, each of shape (vehicles, numbers)."""
        drawn = normal(seed, episode, step, self._width)
        return {
            name: sigma * drawn[:, self._first[name]] for name, sigma in self.deviations.items()
        }
