"""Noise: white noise of observations, a number that depends on seed, episode, step and place alone.

So one vehicle's noise is the same alone and among any number of others. The numbers are made by
hashing, with SplitMix64 (Steele, Lea and Flood 2014, Fast splittable pseudorandom number
generators, OOPSLA), and shaped by Box and Muller's transform.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.suite.noisy import UNSHOWN
from twin.suite.task import GliderTask

Array = NDArray[np.float64]
Words = NDArray[np.uint64]
Counts = NDArray[np.int64]

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
        self, noise: Mapping[str, float] | None, task: GliderTask, widths: Mapping[str, int]
    ):
        """Standard deviations by name, in its unit.

        Args:
          task: whose goals say what they are made of.
          widths: numbers of each observation, by name.

        Raises:
          InputError: no such observation, or a deviation that is negative or not finite.
        """
        behind = {name for made_of in task.goals_from.values() for name in made_of}
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
