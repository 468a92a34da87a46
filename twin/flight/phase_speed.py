"""Phase speed: how much faster or slower than its model a vehicle goes down and up.

A vehicle that is heavier than its model sinks faster and climbs slower. Its depth rate shows it: at
the same pitch the speed is as much larger as the depth rate is. In dead reckoning it is the largest
error that no fix between two dives tells, since it cancels from fix to fix; left in, the track
swings out at depth and back.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.flight.dive import FlownDive

Array = NDArray[np.float64]

LEAST_RATE = 0.03
"""[m/s] of the modelled depth rate below which a vehicle turns or flies level"""
LASTS = 300.0
"""[s] for which the sea's own vertical velocity lasts, internal waves near the buoyancy period"""
LIKELY = 0.15
"""[1] standard deviation of a factor before the log is read: 100 g of ballast in 200 g"""
LOWEST, HIGHEST = 0.6, 1.6
"""[1] beyond which it is no error of ballast: the vehicle is another"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PhaseSpeed:
    """By what the modelled speed is multiplied."""

    descent: float
    """[1]"""
    climb: float
    """[1]"""

    def scaled(self, dive: FlownDive) -> Array:
        """North, east through the water [m/s] of a dive, (time, 2); in turns in between."""
        known = dive.descending | dive.ascending
        if not known.any():
            return dive.velocity
        index = np.arange(len(known))
        factor = np.where(dive.descending, self.descent, self.climb)
        return dive.velocity * np.interp(index, index[known], factor[known])[:, None]


def phase_duration(dive: FlownDive, period: float) -> float | None:
    """[s] Mean of a dive's descents and climbs; None without any."""
    phase = dive.descending.astype(int) - dive.ascending.astype(int)
    held = phase[phase != 0]  # a turn lies between two phases
    if not held.size:
        return None
    return period * held.size / (1 + int((np.diff(held) != 0).sum()))


def phase_speed(dives: Sequence[FlownDive], period: float) -> PhaseSpeed:
    """The factors of the dives of one deployment, 1 where they do not tell.

    Args:
      dives: whose velocity is a flight model's.
      period: [s] between samples.
    """
    return PhaseSpeed(
        descent=_factor(dives, period, 1.0, "descending"),
        climb=_factor(dives, period, -1.0, "ascending"),
    )


def _factor(dives: Sequence[FlownDive], period: float, sign: float, phase: str) -> float:
    """Observed by modelled depth rate, drawn to 1 as far as the sea's own motion hides it."""
    modelled, water = [], []
    for dive in dives:
        use = getattr(dive, phase) & np.isfinite(dive.water_up) & np.isfinite(dive.sink_rate)
        use &= sign * dive.sink_rate > LEAST_RATE
        modelled.append(dive.sink_rate[use])
        water.append(dive.water_up[use])
    model = np.concatenate([*modelled, np.zeros(0)])
    up = np.concatenate([*water, np.zeros(0)])
    if period * model.size < LASTS:
        return 1.0
    found = 1.0 - float(up.mean() / model.mean())
    spread = float(up.std() / abs(model.mean())) / np.sqrt(period * model.size / LASTS)
    found = 1.0 + (found - 1.0) * LIKELY**2 / (LIKELY**2 + spread**2)
    return float(np.clip(found, LOWEST, HIGHEST))
