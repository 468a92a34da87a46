"""Logs: which samples of a store of logs are missing, and how each gap is treated.

A row is one dive. Truth is there only where a current profiler or a Doppler log was. Elsewhere it
is missing, and missing values are neither learned from nor scored. In simulated stores a missing
value stays an error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPEED = "true_speed"
"""Truth of a log with a Doppler log only."""
NO_BRIDGE = ("measured_gps", "measured_dvl")
"""Beginnings of channels whose holes say that nothing was measured."""


def filled(name: str, values: Array) -> Array:
    """A channel with holes bridged by straight lines; truth, fixes and what a Doppler log measured
    stay as they are.

    A channel without any value stays without.
    """
    if not name.startswith(("measured_", "commanded_")) or name.startswith(NO_BRIDGE):
        return values
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    index = np.arange(len(values))
    if name.endswith("heading"):
        turned = np.unwrap(np.deg2rad(values[known]))
        return np.mod(np.rad2deg(np.interp(index, index[known], turned)), 360.0)
    return np.interp(index, index[known], values[known])


def nearest(values: Array, step: int) -> Array:
    """Every `step`-th sample or, where that is missing, the nearest one that is not nearer to
    another: a truth that comes every ten seconds is not lost between the samples."""
    kept = values[::step].copy()
    places = np.arange(0, len(values), step)
    for offset in sorted(range(-((step - 1) // 2), step // 2 + 1), key=abs):
        there = places + offset
        inside = (there >= 0) & (there < len(values)) & ~np.isfinite(kept)
        kept[inside] = values[there[inside]]
    return kept
