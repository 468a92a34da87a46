"""Noise: white noise of observations, a number that depends on seed, episode, step and place alone.

So one vehicle's noise is the same alone and among any number of others. The numbers are made by
hashing, with SplitMix64 (Steele, Lea and Flood 2014, Fast splittable pseudorandom number
generators, OOPSLA), and shaped by Box and Muller's transform.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name

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
    """White noise of some of a task's observations."""

    def __init__(self, noise: Mapping[str, float] | None, widths: Mapping[str, int]):
        """Standard deviations by name of the observation, in its unit.

        Args:
          widths: numbers of each observation, by name.

        Raises:
          InputError: no such observation, or a deviation that is negative or not finite.
        """
        self._deviations = dict(noise or {})
        self._width = sum(widths.values())
        self._first: dict[str, slice] = {}
        end = 0
        for name, width in widths.items():
            self._first[name] = slice(end, end + width)
            end += width
        for name, deviation in self._deviations.items():
            if name not in widths:
                raise InputError(unknown_name("observation of this task", name, widths))
            if not (np.isfinite(deviation) and deviation >= 0.0):
                raise InputError(f"noise of {name} is {deviation!r}: give 0 or more")

    def add(
        self, found: Mapping[str, Any], seed: Counts, episode: Counts, step: Counts
    ) -> Mapping[str, Any]:
        """Observations of one vehicle or of many, with their noise."""
        if not self._deviations:
            return found
        drawn = normal(seed, episode, step, self._width)
        noisy = dict(found)
        for name, deviation in self._deviations.items():
            own = drawn[:, self._first[name]].reshape(np.shape(found[name]))
            noisy[name] = found[name] + deviation * own
        return noisy
