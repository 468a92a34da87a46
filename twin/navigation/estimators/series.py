"""Series: averages, gaps and the surface in measured channels, which several methods share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.navigation.dead_reckoning import Array, depth_rate
from twin.vehicle.laws.flow_frame import is_flow_frame
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


def no_glider(vehicle: Vehicle) -> str:
    """Why a vehicle does not glide by lift and drag coefficients; empty: it does.

    For methods that take a glider's balance of forces for granted.
    """
    if vehicle.steered("speed") is not None:
        return f"vehicle {vehicle.name!r} has a propeller: it does not glide"
    if vehicle.steered("buoyancy") is None:
        return f"vehicle {vehicle.name!r} has no pump: it does not glide"
    if not is_flow_frame(vehicle.law):
        return (
            f"vehicle {vehicle.name!r} has the hull law {vehicle.law.kind!r}: no lift and drag "
            "coefficients"
        )
    return ""


def afloat(depth: Array, period: float) -> Mask:
    """Where a vehicle with this measured depth [m] lies at the surface, (time,)."""
    rate = smooth(depth_rate(depth, period), RESTING_WINDOW_S, period)
    resting = (depth < SHALLOW_DEPTH) & (np.abs(rate) < RESTING_RATE)
    return resting | (depth < SURFACE_DEPTH)


def smooth(values: Array, seconds: float, period: float) -> Array:
    """Centred moving average over about `seconds`, shorter at the ends; (..., time)."""
    half = round(0.5 * seconds / period)
    count = values.shape[-1]
    total = np.zeros((*values.shape[:-1], count + 1))
    np.cumsum(values, axis=-1, out=total[..., 1:])
    index = np.arange(count)
    first = np.maximum(index - half, 0)
    last = np.minimum(index + half + 1, count)
    return np.asarray((total[..., last] - total[..., first]) / (last - first))


def hold(values: Array, valid: Mask, initial: float = 0.0) -> Array:
    """The last valid value at each sample, `initial` before the first; (time,)."""
    last = np.maximum.accumulate(np.where(valid, np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], initial)


def bridge(values: Array, valid: Mask, outside: float = 0.0, *, held: bool = False) -> Array:
    """Values with the samples that are not valid interpolated in between; (time,).

    Before the first and after the last valid sample, and without any, `outside`; with `held` the
    last valid value after it.
    """
    index = np.arange(len(values))
    if not valid.any():
        return np.full(len(values), outside)
    after = values[valid][-1] if held else outside
    return np.interp(index, index[valid], values[valid], left=outside, right=after)
