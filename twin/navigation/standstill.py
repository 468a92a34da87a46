"""Standstill of a propelled vehicle without a Doppler log, and its largest speed.

A vehicle under way moves nearly along its nose: the path differs from the pitch by the angle of
attack, which the hull's lift keeps small. The depth rate w therefore limits the surge u,

    w = u (s + a c),   s = -sin(pitch),  c = cos(pitch),  |a| <= tan(largest angle of attack),

where the nose points up or down by more than that angle: a vehicle that lies on the bottom, or that
rises by its buoyancy, with its nose down stands. A level vehicle's depth rate limits nothing; there
a propeller shows it that has been off for longer than the vehicle coasts. While it turns, a vehicle
is under way: at the surface, a nose that is held down does not take it down.
"""

from __future__ import annotations

import math

import numpy as np

from twin.errors import InputError
from twin.navigation.dead_reckoning import Array, Mask, depth_rate, smooth

LARGEST_ATTACK = math.radians(12.0)
"""[rad] Largest angle of attack under way: fins stall at about 15 degrees, and a trimmed hull stays
below. Between 6 and 15 degrees, 79 to 82 % of a real vehicle's rest on the bottom is found."""
DEPTH_NOISE = 0.02
"""[m/s] Error of the averaged depth rate: steps of 0.1 m of a depth over `WINDOW`"""
WINDOW = 20.0
"""[s] Averaging time of depth rate and pitch: several oscillations of a hull in pitch"""
STILL = 0.3
"""[m/s] Surge below which a vehicle counts as standing: currents of coastal water are as fast"""
COAST = 20.0
"""[s] Time in which a vehicle loses its way: a drag of 0.45 u^2 per metre takes 6 s from 1.5 m/s to
`STILL`, that of a vehicle three times as long 18 s"""
TURNING = 0.05
"""[1] Speed of a propeller, as a fraction of its largest in the log, below which it is off: motor
controllers report a few revolutions at rest"""
NOISE_WINDOW = 30.0
"""[s] Averaging time of the yaw rate's square"""
LEAST_GAIN = 0.5
"""[1] Smallest excess of the fraction of standing samples below a limit over that of moving
samples, for the limit to divide them; chance has 0"""


def largest_surge(depth: Array, pitch: Array, period: float) -> Array:
    """Largest surge [m/s] that agrees with the depth rate, (time,); infinite for a level vehicle.

    Args:
      depth: [m], (time,). pitch: [rad], (time,). period: [s] between samples.

    Raises:
      InputError: depth and pitch differ in length.
    """
    if depth.shape != pitch.shape or depth.ndim != 1:
        raise InputError(
            f"depth {depth.shape} and pitch {pitch.shape} must be (time,), of one length"
        )
    if depth.size < 2:
        return np.full(depth.size, np.inf)
    rate = smooth(depth_rate(depth, period), WINDOW, period)
    down = smooth(-np.sin(pitch), WINDOW, period)
    steep = np.abs(down) - math.tan(LARGEST_ATTACK) * np.sqrt(1.0 - down**2)
    along = np.sign(down) * rate  # positive where the depth changes as the nose points
    free = np.full(depth.size, np.inf)
    return np.divide(np.maximum(along + DEPTH_NOISE, 0.0), steep, out=free, where=steep > 0.0)


def standing(
    pitch: Array,
    period: float,
    *,
    depth: Array | None = None,
    propeller: Array | None = None,
    yaw_rate: Array | None = None,
    quiet: float = 0.0,
) -> Mask:
    """Samples at which a vehicle stands, (time,).

    Args:
      pitch: [rad], (time,). period: [s] between samples.
      depth: [m], (time,), where the log has it.
      propeller: its speed in any unit, 0 at rest, (time,), where the log has it.
      yaw_rate: [rad/s], (time,).
      quiet: [rad/s] RMS yaw rate below which the vehicle stands, see `quiet_rate`; 0: unknown.
    """
    still = np.zeros(pitch.shape, bool)
    if quiet > 0.0 and yaw_rate is not None:
        still |= yaw_noise(yaw_rate, period) < quiet
    if depth is not None:
        still |= largest_surge(depth, pitch, period) < STILL
    if propeller is not None:
        speed = np.abs(np.nan_to_num(propeller))
        turning = speed > TURNING * speed.max()
        last = np.maximum.accumulate(np.where(turning, np.arange(pitch.size), -np.inf))
        still = (still & ~turning) | ((np.arange(pitch.size) - last) * period > COAST)
    return still


def yaw_noise(yaw_rate: Array, period: float) -> Array:
    """RMS of the yaw rate [rad/s] over `NOISE_WINDOW`, (time,): without way no hull steers."""
    return np.sqrt(np.maximum(smooth(yaw_rate**2, NOISE_WINDOW, period), 0.0))


def quiet_rate(noise: Array, surge: Array) -> float:
    """RMS yaw rate [rad/s] that best divides standing from moving samples of runs with a velocity.

    The fraction of standing samples below it less that of moving samples is largest. The result is
    0 where the runs have no standing or no moving samples.

    Args:
      noise: `yaw_noise` of the runs, joined, (samples,). surge: [m/s] measured, NaN without.
    """
    known = np.isfinite(surge)
    order = np.argsort(noise[known])
    still = np.abs(surge[known][order]) < STILL
    if still.all() or not still.any():
        return 0.0
    gain = np.cumsum(still) / still.sum() - np.cumsum(~still) / (~still).sum()
    best = int(np.argmax(gain))
    return float(noise[known][order][best]) if gain[best] > LEAST_GAIN else 0.0
