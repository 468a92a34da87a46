"""Closure: the tilt of a Doppler log's mount, from the depth rate that its velocities must make.

The vertical component of the hull's velocity past the water is the depth rate, less what the water
sinks. Tilt and scale are fitted to all ensembles together: a tilt adds the same vertical velocity
in dives and in climbs, a scale changes its size. Neither needs dives and climbs to be alike. A mean
vertical current of the water over the whole record counts as tilt. The vertical velocity is noisy
and the depth rate is not, so the first is fitted by the second.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.signal import savgol_filter

from factory.importing.doppler.pd0 import Array
from factory.importing.doppler.relative_velocity import Mask

STEP, WINDOW, LONGEST = 1.0, 15, 20.0
"""STEP: [s] time step. WINDOW: number of steps of the line whose slope is the depth rate. LONGEST:
[s] longest time between depths; a longer gap has no rate."""
DEEP, MOVING = 2.0, 0.1
"""DEEP: [m] depth above which waves move the vehicle. MOVING: [m/s] speed that shows the tilt."""
TILT, SCALE = np.radians(10.0), 0.03
"""Standard deviations before the fit. TILT: [rad] of the tilt. SCALE: [1] of the scale."""
BLOCK, MINUTE = 300.0, 60.0
"""[s] BLOCK: time in which errors are equal. MINUTE: time over which closure is judged."""
ROUNDS, OUTLIER = 12, 3.0
"""ROUNDS: number of fits. OUTLIER: robust standard deviations that make an outlier."""
ROBUST = 1.4826
"""Standard deviation over the median absolute value, of a normal distribution."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Closure:
    """Result of the fit of a mount's tilt."""

    tilt: float
    """[rad] Pitch of the Doppler log against the hull, positive nose up."""
    tilt_deviation: float
    """[rad] Standard deviation of the tilt."""
    scale: float
    """Vertical velocity that the Doppler log shows over the depth rate; it is not taken out."""
    scale_deviation: float
    residual: float
    """[m/s] Robust standard deviation of what does not close, of one ensemble."""
    ensembles: int
    """Ensembles in the fit."""


def depth_rate(time: Array, depth: Array, at: Array) -> Array:
    """Depth rate [m/s] at times [s], by a line through `WINDOW` steps; NaN in gaps."""
    rate = np.full(len(at), np.nan)
    for piece in np.split(np.arange(len(time)), np.flatnonzero(np.diff(time) > LONGEST) + 1):
        if not len(piece) or time[piece[-1]] - time[piece[0]] < (WINDOW - 1) * STEP:
            continue
        steps = np.arange(time[piece[0]], time[piece[-1]] + STEP, STEP)
        known = np.interp(steps, time[piece], depth[piece])
        inside = (at >= time[piece[0]]) & (at <= time[piece[-1]])
        rates = savgol_filter(known, WINDOW, 1, deriv=1, delta=STEP)
        rate[inside] = np.interp(at[inside], steps, rates)
    return rate


def tilted(velocity: Array, tilt: float) -> Array:
    """Turn velocities (ensembles, 3) from a Doppler log with a tilt [rad] to the hull's axes."""
    cosine, sine = np.cos(tilt), np.sin(tilt)
    u, v, w = velocity.T
    return np.stack([u * cosine + w * sine, v, w * cosine - u * sine], axis=1)


def downward(velocity: Array, roll: Array, pitch: Array) -> Array:
    """Component [m/s] straight down of velocities (ensembles, 3) in hull axes; angles in rad."""
    u, v, w = velocity.T
    return (v * np.sin(roll) + w * np.cos(roll)) * np.cos(pitch) - u * np.sin(pitch)


def fit_tilt(
    time: Array, velocity: Array, roll: Array, pitch: Array, rate: Array, depth: Array
) -> Closure:
    """Fit tilt and scale to ensembles; their priors decide where the record does not.

    Args:
      time: [s], depth: [m], rate: [m/s] depth rate, each (ensembles,).
      velocity: [m/s] of the hull in the Doppler log's axes, (ensembles, 3), NaN where dropped.
      roll, pitch: [rad] of the hull.
    """
    speed = np.linalg.norm(velocity, axis=1)
    use = np.isfinite(rate + roll + pitch) & (speed > MOVING) & (depth > DEEP)
    time, velocity, roll, pitch, rate = (a[use] for a in (time, velocity, roll, pitch, rate))
    start, deviation, residual = np.array([0.0, 1.0]), np.array([TILT, SCALE]), np.inf
    prior, found = np.diag(deviation**-2), start
    for _ in range(ROUNDS if len(time) else 0):
        own = tilted(velocity, found[0])
        down = downward(own, roll, pitch)
        turn = np.stack([own[:, 2], np.zeros(len(own)), -own[:, 0]], axis=1)
        misfit = found[1] * rate - down
        middle = float(np.median(misfit))
        residual = max(ROBUST * float(np.median(np.abs(misfit - middle))), 1e-3)
        sound = np.abs(misfit) < OUTLIER * residual + abs(middle)
        columns = np.stack([downward(turn, roll, pitch), -rate], axis=1)[sound] / residual
        weighted = misfit[sound] / residual
        inverse = np.linalg.inv(columns.T @ columns + prior)
        found = found + inverse @ (columns.T @ weighted - prior @ (found - start))
        clustered = _clustered(time[sound], columns, weighted, prior, inverse)
        deviation = np.sqrt(np.maximum(np.diag(clustered), np.diag(inverse)))
    return Closure(
        tilt=float(found[0]), tilt_deviation=float(deviation[0]), scale=float(found[1]),
        scale_deviation=float(deviation[1]), residual=residual, ensembles=len(time),
    )  # fmt: skip


def _clustered(time: Array, columns: Array, misfit: Array, prior: Array, inverse: Array) -> Array:
    """Covariance of a fit whose misfits are alike within `BLOCK`; the prior is one block more."""
    blocks = np.unique(np.floor((time - time[0]) / BLOCK), return_inverse=True)[1]
    sums = np.zeros((blocks.max() + 1, columns.shape[1]))
    np.add.at(sums, blocks, columns * misfit[:, None])
    few = len(sums) / max(len(sums) - len(prior), 1)  # the fit takes a part of few blocks' misfits
    return np.asarray(inverse @ (few * sums.T @ sums + prior) @ inverse)


def closes(time: Array, velocity: Array, down: Array, rate: Array, share: float) -> Mask:
    """True for ensembles around which, over a minute, the vertical velocity makes the depth rate.

    Args:
      time: [s]; down, rate: [m/s]; (ensembles,), finite.
      velocity: [m/s], (ensembles, 3).
      share: largest difference, as a fraction of the speed.
    """
    first = np.searchsorted(time, time - 0.5 * MINUTE)
    last = np.searchsorted(time, time + 0.5 * MINUTE, side="right")

    def mean(values: Array) -> Array:
        sums = np.concatenate([[0.0], np.cumsum(values)])
        return (sums[last] - sums[first]) / (last - first)

    misfit = down - rate
    steps = np.abs(np.diff(misfit)) / np.sqrt(2.0)
    noise = ROBUST * np.median(steps) if len(steps) else 0.0
    speed = np.maximum(np.linalg.norm(velocity, axis=1), np.abs(rate))
    allowed = share * mean(speed) + 2.0 * noise / np.sqrt(last - first)
    return np.asarray(np.abs(mean(misfit)) <= allowed)
