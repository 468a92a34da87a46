"""Signs and scales of a log compared with how gliders move; contradictions are reported.

A glider sinks nose down and rises nose up; it rises with more volume than it sinks with; it is
neither faster than a thruster makes it nor slower than its own noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factory.importing.reading.deployment_log import Channel, DeploymentLog
from factory.importing.reading.tally import Tally

Array = NDArray[np.float64]

_BELOW = 5.0
"""[m] Waves and the surfacing are above."""
_MOVING = 0.04
"""[m/s] Vertical speed of a glide."""
_ENOUGH = 20
"""Samples each of descent and climb."""
FASTEST, SLOWEST = 2.0, 0.04
"""[m/s] Speeds along the pitch that no glider has; usual are 0.2 to 0.6."""
_STEEP = 8.0
"""[degree] Flatter, the vertical speed says little about the speed."""


_ROLLED = 45.0
"""[degree] No glider rolls by more for half of its time under water."""


def vertical_speed(depth: Channel) -> Array:
    """[m/s] Down positive, at the channel's samples."""
    if len(depth) < 3:
        return np.zeros(len(depth))
    return np.asarray(np.gradient(depth.values, depth.time), np.float64)


def speed_along_pitch(depth: Channel, pitch: Channel) -> float:
    """[m/s] Median of vertical speed over sin(pitch) in glides; NaN without enough of them."""
    if not len(depth) or not len(pitch):
        return float("nan")
    angle = pitch.at(depth.time)
    rate = np.abs(vertical_speed(depth))
    level = 0.1 * float(np.percentile(rate, 90.0))
    use = (np.abs(angle) > _STEEP) & (rate > level)
    if use.sum() < _ENOUGH:
        return float("nan")
    return float(np.median(rate[use] / np.sin(np.radians(np.abs(angle[use])))))


def check_signs(log: DeploymentLog, tally: Tally) -> None:
    """Report channels whose sign or scale contradicts the dives, as `suspect`."""
    depth = log.channel("measured_depth")
    rate = vertical_speed(depth)
    below = depth.values > _BELOW
    roll = log.channel("measured_roll")
    if len(roll) and below.sum() > _ENOUGH:
        usual = float(np.median(np.abs(roll.at(depth.time[below]))))
        if usual > _ROLLED:
            tally.add(
                "suspect", "measured_roll", len(roll),
                f"{log.deployment} rolls by {usual:.0f} degree: wrong unit or column",
            )  # fmt: skip
    down, up = below & (rate > _MOVING), below & (rate < -_MOVING)
    if min(down.sum(), up.sum()) < _ENOUGH:
        return
    pitch, pump = log.channel("measured_pitch"), log.channel("measured_pump")
    if len(pitch):
        angle = pitch.at(depth.time)
        if np.median(angle[down]) > np.median(angle[up]):
            tally.add(
                "suspect", "measured_pitch", len(pitch),
                f"{log.deployment} sinks nose up: wrong sign or column",
            )  # fmt: skip
        speed = speed_along_pitch(depth, pitch)
        if speed > FASTEST or speed < SLOWEST:
            tally.add(
                "suspect", "measured_depth", len(depth),
                f"{log.deployment} would move at {speed:.2g} m/s: wrong unit of depth or pitch",
            )  # fmt: skip
    propelled = len(log.channel("thruster")) and np.mean(log.channel("thruster").values) > 0.0
    if len(pump) and not propelled:
        volume = pump.at(depth.time)
        if np.median(volume[down]) > np.median(volume[up]):
            tally.add(
                "suspect", "measured_pump", len(pump),
                f"{log.deployment} sinks with more volume than it rises with: wrong sign or column",
            )  # fmt: skip
