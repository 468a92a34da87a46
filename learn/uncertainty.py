"""Uncertainty: how far a dead-reckoned position may be off, along the track.

The error of a velocity component is taken as a stationary Gauss-Markov process with standard
deviation s and correlation time T. Its integral has the variance (Papoulis 1991, section 10)

    P(t) = 2 s^2 T [t - T (1 - exp(-t / T))],

s^2 t^2 while t << T (a bias) and 2 s^2 T t for t >> T (a random walk). A heading error moves the
position across the distance made good, and a fix resets everything to its own accuracy.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from learn.dead_reckoning import Array, integrate
from twin.errors import InputError

SECONDS_PER_HOUR = 3600.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorModel:
    """What a navigator believes about the errors; defaults for a calibrated compass."""

    velocity_sd: float = 0.005
    """[m/s] standard deviation of each horizontal component of the velocity through the water; an
    ensemble's spread replaces it sample by sample."""
    velocity_time: float = 1800.0
    """[s] correlation time of that error: about a dive, since trim and buoyancy change with it."""
    heading_sd: float = 0.014
    """[rad] constant heading error: 0.8 deg, the paper's sensor table."""
    current_sd: float = 0.0
    """[m/s] standard deviation of each component of the unknown current; 0 for tracks through the
    water."""
    current_time: float = 3.0 * SECONDS_PER_HOUR
    """[s] its correlation time: a quarter of the semidiurnal tide."""
    fix_sd: float = 4.0
    """[m] each component of a GPS fix: 3 to 5 m is usual."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"error model {field.name} is {value!r}: it must be at least 0")


def position_sd(
    velocity: Array,
    period: float,
    model: ErrorModel,
    *,
    velocity_sd: Array | None = None,
    fixes: NDArray[np.intp] | None = None,
) -> Array:
    """Standard deviation [m] of the horizontal position, root of the sum of both axes, (time,).

    Args:
      velocity: estimated north, east [m/s], (time, 2).
      period: [s] between samples.
      model: what is believed about the errors.
      velocity_sd: [m/s], (time,), of each component, in place of the model's constant.
      fixes: samples at which the position is reset to a fix.
    """
    samples = len(velocity)
    spread = np.full(samples, model.velocity_sd) if velocity_sd is None else velocity_sd
    reset = np.zeros(samples, bool)
    if fixes is not None:
        reset[fixes] = True
    water = _integrated_variance(spread, model.velocity_time, period, reset)
    drift = np.full(samples, model.current_sd)
    current = _integrated_variance(drift, model.current_time, period, reset)
    along = _since_reset(velocity, period, reset)
    across = (model.heading_sd * np.hypot(*along.T)) ** 2
    start = np.where(np.cumsum(reset) > 0, 2.0 * model.fix_sd**2, 0.0)
    return np.sqrt(start + 2.0 * (water + current) + across)


def _integrated_variance(
    spread: Array, time: float, period: float, reset: NDArray[np.bool_]
) -> Array:
    """Variance of the integral of a Gauss-Markov process of slowly varying deviation, (time,).

    Exact recursion for a constant deviation: with c = cov(integral, process), a = exp(-h / T),
    P += 2 c T (1 - a) + 2 s^2 T [h - T (1 - a)] and c = a c + s^2 T (1 - a). At a reset the
    position is known but the velocity's error is not: both restart from the fix.
    """
    if time == 0.0:
        return np.zeros(len(spread))
    decay = np.exp(-period / time)
    kept = time * (1.0 - decay)
    out = np.zeros(len(spread))
    variance = covariance = 0.0
    for k in range(1, len(spread)):
        if reset[k]:
            variance = covariance = 0.0
        else:
            power = spread[k - 1] ** 2
            variance += 2.0 * covariance * kept + 2.0 * power * time * (period - kept)
            covariance = decay * covariance + power * kept
        out[k] = variance
    return out


def _since_reset(velocity: Array, period: float, reset: NDArray[np.bool_]) -> Array:
    """Distance made good [m] north, east since the last reset, (time, 2)."""
    track = integrate(velocity, period)
    last = np.maximum.accumulate(np.where(reset, np.arange(len(reset)), 0))
    return track - track[last]
