"""Flight summary: a flight model tested by the water's vertical velocity, and its speed factors.

The water rises as often as it sinks, in descents and in climbs: unequal means show a model error.

A speed factor is the ratio of a vehicle's speed to its model's speed in descents or in climbs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.logs.flight_estimator import FlownDive

MOST_APART, MOST_MEAN = 0.01, 0.015
"""[m/s] A good model's limits. MOST_APART: descents' mean minus climbs'. MOST_MEAN: either mean"""
BIN_HEIGHT = 20.0
"""[m] Largest height of a depth bin"""
LEAST_SAMPLES = 30
"""Minimum number of samples of a bin in descents, and as many in climbs; other bins are left out"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlightSummary:
    """Statistics of the vertical water velocity; NaN if no sample has one."""

    w_mean_dive: float
    """[m/s] Mean vertical water velocity in descents, positive up"""
    w_mean_climb: float
    """[m/s] Mean vertical water velocity in climbs, positive up"""
    w_deviation: float
    """[m/s] Standard deviation of the vertical water velocity over all samples"""
    depth_rate_rmse: float
    """[m/s] Root mean square of modelled minus observed depth rate, with its mean included"""
    samples: int
    w_profile_difference: float = float("nan")
    """[m/s] Mean in descents minus mean in climbs, in the depth bin with the largest difference;
    a bin is `BIN_HEIGHT` high, or a tenth of the depth range if that is less"""

    @property
    def suspect(self) -> bool:
        """True if the means of descents and climbs exceed MOST_MEAN, or differ by MOST_APART."""
        means = np.array([self.w_mean_dive, self.w_mean_climb])
        return bool(abs(means[0] - means[1]) > MOST_APART or (np.abs(means) > MOST_MEAN).any())

    def doubt(self, vehicle: str) -> str:
        """Message that a vehicle of this name does not fit the log; empty if it may fit."""
        if not self.suspect:
            return ""
        return (
            f"vertical water velocity is {100 * self.w_mean_dive:.1f} cm/s in dives and "
            f"{100 * self.w_mean_climb:.1f} in climbs: the vehicle {vehicle} does not fit the log, "
            "not the water"
        )

    def describe(self) -> dict[str, float]:
        """Statistics by name; each name ends with its unit."""
        return {
            "w_mean_dive_m_s": self.w_mean_dive,
            "w_mean_climb_m_s": self.w_mean_climb,
            "w_profile_difference_m_s": self.w_profile_difference,
            "w_sd_m_s": self.w_deviation,
            "depth_rate_rmse_m_s": self.depth_rate_rmse,
        }


def summarise(dives: Sequence[FlownDive]) -> FlightSummary:
    """Summarise the vertical water velocity over some dives."""
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
    """[m/s] Mean in descents minus mean in climbs, in the bin with the largest difference."""
    both = down | up
    if not both.any():
        return float("nan")
    top = float(depth[both].min())
    size = min(BIN_HEIGHT, float(np.ptp(depth[both])) / 10.0)
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
"""[m/s] Modelled depth rate; at less, the vehicle turns or flies level, and a sample is left out"""
CORRELATION_TIME = 300.0
"""[s] Correlation time of the water's vertical velocity: internal waves near the buoyancy period"""
PRIOR_DEVIATION = 0.15
"""[1] Prior standard deviation of a factor, as from 100 g of ballast error in 200 g of buoyancy"""
LOWEST, HIGHEST = 0.6, 1.6
"""[1] Limits of a factor; beyond them, the log is from another vehicle than the model's"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PhaseSpeed:
    """Ratios of observed to modelled speed, one for descents and one for climbs."""

    descent: float
    """[1] Ratio in descents"""
    climb: float
    """[1] Ratio in climbs"""

    def scaled(self, dive: FlownDive) -> Array:
        """Velocity [m/s], (time, 2), times its phase's ratio; between phases it is interpolated."""
        known = dive.descending | dive.ascending
        if not known.any():
            return dive.velocity
        index = np.arange(len(known))
        factor = np.where(dive.descending, self.descent, self.climb)
        return dive.velocity * np.interp(index, index[known], factor[known])[:, None]


def phase_duration(dive: FlownDive, period: float) -> float | None:
    """[s] Mean duration of a dive's descents and climbs; None without any."""
    phase = dive.descending.astype(int) - dive.ascending.astype(int)
    held = phase[phase != 0]  # a turn lies between two phases
    if not held.size:
        return None
    return period * held.size / (1 + int((np.diff(held) != 0).sum()))


def phase_speed(dives: Sequence[FlownDive], period: float) -> PhaseSpeed:
    """Estimate the speed ratios from one deployment's dives; 1 if the data are too short.

    Args:
      dives: dives whose velocity comes from a flight model.
      period: [s] between samples.
    """
    return PhaseSpeed(
        descent=_factor(dives, period, 1.0, "descending"),
        climb=_factor(dives, period, -1.0, "ascending"),
    )


def _factor(dives: Sequence[FlownDive], period: float, sign: float, phase: str) -> float:
    """Ratio of observed to modelled depth rate; a large uncertainty moves it toward 1."""
    modelled, water = [], []
    for dive in dives:
        use = getattr(dive, phase) & np.isfinite(dive.water_up) & np.isfinite(dive.sink_rate)
        use &= sign * dive.sink_rate > LEAST_RATE
        modelled.append(dive.sink_rate[use])
        water.append(dive.water_up[use])
    model = np.concatenate([*modelled, np.zeros(0)])
    up = np.concatenate([*water, np.zeros(0)])
    if period * model.size < CORRELATION_TIME:
        return 1.0
    found = 1.0 - float(up.mean() / model.mean())
    spread = float(up.std() / abs(model.mean())) / np.sqrt(period * model.size / CORRELATION_TIME)
    found = 1.0 + (found - 1.0) * PRIOR_DEVIATION**2 / (PRIOR_DEVIATION**2 + spread**2)
    return float(np.clip(found, LOWEST, HIGHEST))
