"""What every way to estimate velocities gives and may see: one interface for all of them."""

from __future__ import annotations

import abc
import dataclasses
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from learn.navigation.dead_reckoning import Array, Signals, depth_rate
from twin.vehicle.vehicle import Vehicle

Mask = NDArray[np.bool_]

SURFACE_DEPTH = 1.0
"""[m] above this a vehicle counts as afloat: it drifts and makes no way through the water."""
SHALLOW_DEPTH = 3.0
"""[m] above this it does when its depth rests too: pressure gauges are off by a metre or two."""
RESTING_RATE = 0.02
"""[m/s] of depth, averaged: a tenth of the slowest glide."""
RESTING_WINDOW_S = 10.0
"""[s] of that average."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Estimate:
    """Velocities of one mission; what a method cannot know is None."""

    surge: Array | None = None
    """[m/s] through the water, forward, (time,)"""
    sway: Array | None = None
    """[m/s] through the water, starboard, (time,)"""
    surge_sd: Array | None = None
    """[m/s] standard deviation that the method claims for `surge`, (time,)"""
    sway_sd: Array | None = None
    """[m/s] as `surge_sd`"""
    ground_track: Array | None = None
    """[m] north, east over ground since the first sample, (time, 2), of a method that makes its
    own track."""
    uses_fixes: bool = False
    """`ground_track` is reset at GPS fixes and carries the depth-averaged current."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Baseline(abc.ABC):
    """A way to estimate velocities from what a vehicle measures and commands.

    It knows the vehicle as its file says, never as a mission drew it.
    """

    channels: ClassVar[tuple[str, ...]]
    """Schema variables that it reads; none of them is truth."""

    vehicle: Vehicle
    """Nominal parameters."""

    @abc.abstractmethod
    def estimate(self, signals: Signals, period: float) -> Estimate:
        """Velocities from channels (time,), one sample every `period` [s].

        Raises:
          StoreError: a channel is missing or not finite.
        """


def afloat(depth: Array, period: float) -> Mask:
    """Where a vehicle with this measured depth [m] lies at the surface, (time,)."""
    rate = smooth(depth_rate(depth, period), RESTING_WINDOW_S, period)
    resting = (depth < SHALLOW_DEPTH) & (np.abs(rate) < RESTING_RATE)
    return resting | (depth < SURFACE_DEPTH)


def smooth(values: Array, seconds: float, period: float) -> Array:
    """Centred moving average over about `seconds`, shorter at the ends; (time,)."""
    half = round(0.5 * seconds / period)
    total = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(len(values))
    first = np.maximum(index - half, 0)
    last = np.minimum(index + half + 1, len(values))
    return (total[last] - total[first]) / (last - first)


def hold(values: Array, valid: Mask, initial: float = 0.0) -> Array:
    """The last valid value at each sample, `initial` before the first; (time,)."""
    last = np.maximum.accumulate(np.where(valid, np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], initial)


def bridge(values: Array, valid: Mask, outside: float = 0.0) -> Array:
    """Values with the samples that are not valid interpolated in between; (time,).

    Before the first and after the last valid sample, and without any, `outside`.
    """
    index = np.arange(len(values))
    if not valid.any():
        return np.full(len(values), outside)
    return np.interp(index, index[valid], values[valid], left=outside, right=outside)
