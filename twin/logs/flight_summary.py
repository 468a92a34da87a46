"""Summary: what the vertical velocity of the water says of a flight model.

The ocean rises and sinks as often in dives as in climbs: their means part where the model errs.

Phase speed: how much faster or slower than its model a vehicle goes down and up.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.logs.flight_estimator import FlownDive

MOST_APART, MOST_MEAN = 0.01, 0.015
"""[m/s] Means of dives and climbs of an identified vehicle differ by less, and are smaller."""
BIN = 20.0
"""[m]"""
LEAST_SAMPLES = 30
"""of the dives, and of the climbs, in a bin that counts"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlightSummary:
    """Over all samples under water where the model holds; NaN without any."""

    w_mean_dive: float
    """[m/s] upward, mean over the dives"""
    w_mean_climb: float
    """[m/s] over the climbs"""
    w_deviation: float
    """[m/s] standard deviation"""
    depth_rate_rmse: float
    """[m/s] depth rate observed less that of the model: the same with its mean"""
    samples: int
    w_profile_difference: float = float("nan")
    """[m/s] largest mean of the dives less that of the climbs in a bin of depth, with its sign;
    bins are `BIN` deep, or a tenth of the depths where that is less"""

    @property
    def suspect(self) -> bool:
        """Whether the means part, or are so large, that the model is not this vehicle's."""
        means = np.array([self.w_mean_dive, self.w_mean_climb])
        return bool(abs(means[0] - means[1]) > MOST_APART or (np.abs(means) > MOST_MEAN).any())

    def doubt(self, vehicle: str) -> str:
        """Why the model of a vehicle of this name is not this vehicle's; empty where it may be."""
        if not self.suspect:
            return ""
        return (
            f"vertical water velocity is {100 * self.w_mean_dive:.1f} cm/s in dives and "
            f"{100 * self.w_mean_climb:.1f} in climbs: the vehicle {vehicle} does not fit the log, "
            "not the water"
        )

    def describe(self) -> dict[str, float]:
        """The figures with their units in the names."""
        return {
            "w_mean_dive_m_s": self.w_mean_dive,
            "w_mean_climb_m_s": self.w_mean_climb,
            "w_profile_difference_m_s": self.w_profile_difference,
            "w_sd_m_s": self.w_deviation,
            "depth_rate_rmse_m_s": self.depth_rate_rmse,
        }


def summarise(dives: Sequence[FlownDive]) -> FlightSummary:
    """Figures over some dives."""
    every = np.concatenate([dive.water_up for dive in dives])
    down = np.concatenate([dive.descending for dive in dives])
    up = np.concatenate([dive.ascending for dive in dives])
    known = np.isfinite(every)
    return FlightSummary(
        w_mean_dive=_mean(every[down & known]),
        w_mean_climb=_mean(every[up & known]),
        w_deviation=float(np.std(every[known])) if known.any() else float("nan"),
        depth_rate_rmse=float(np.sqrt(_mean(every[known] ** 2))),
        samples=int(known.sum()),
        w_profile_difference=_profile_difference(
            np.concatenate([dive.depth for dive in dives]), every, down & known, up & known
        ),
    )


def _profile_difference(
    depth: np.ndarray, w: np.ndarray, down: np.ndarray, up: np.ndarray
) -> float:
    """[m/s] Largest difference of the means, dives less climbs, over bins of depth."""
    both = down | up
    if not both.any():
        return float("nan")
    top = float(depth[both].min())
    size = min(BIN, float(np.ptp(depth[both])) / 10.0)
    if not size > 0.0:
        return float("nan")
    index = np.where(both, (depth - top) / size, -1.0).astype(int)
    largest = float("nan")
    for k in range(int(index.max()) + 1):
        one, other = w[down & (index == k)], w[up & (index == k)]
        if min(one.size, other.size) < LEAST_SAMPLES:
            continue
        difference = float(one.mean() - other.mean())
        if not abs(difference) <= abs(largest):
            largest = difference
    return largest


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if values.size else float("nan")


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
    """Factors of the modelled speed."""

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
