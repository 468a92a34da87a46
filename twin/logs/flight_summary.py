"""Flight summary: vertical velocity of the water as a test of a flight model, and phase speeds.

The ocean rises and sinks equally often in dives and climbs: unequal means show a model error.

A phase speed is the factor by which a vehicle is faster than its model in descents or climbs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.logs.flight_estimator import FlownDive

MOST_APART, MOST_MEAN = 0.01, 0.015
"""[m/s] Largest difference of the means of dives and climbs, and largest mean, of a good model"""
BIN = 20.0
"""[m] Depth of a bin"""
LEAST_SAMPLES = 30
"""Fewest samples of the dives, and of the climbs, in a bin that counts"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlightSummary:
    """Vertical water velocity over all samples where the model holds; NaN without any."""

    w_mean_dive: float
    """[m/s] Mean over the dives, positive up"""
    w_mean_climb: float
    """[m/s] Mean over the climbs, positive up"""
    w_deviation: float
    """[m/s] Standard deviation over all samples"""
    depth_rate_rmse: float
    """[m/s] Root mean square of modelled minus observed depth rate, mean included"""
    samples: int
    w_profile_difference: float = float("nan")
    """[m/s] Largest difference, with its sign, of the means of dives and climbs in a bin of depth;
    bins are `BIN` deep, or a tenth of the depth range if that is less"""

    @property
    def suspect(self) -> bool:
        """Whether the means differ or are large enough to show that the model does not fit."""
        means = np.array([self.w_mean_dive, self.w_mean_climb])
        return bool(abs(means[0] - means[1]) > MOST_APART or (np.abs(means) > MOST_MEAN).any())

    def doubt(self, vehicle: str) -> str:
        """Message that the vehicle does not fit the log; empty if it may fit."""
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
    """[m/s] Largest difference of the means of dives and climbs over bins of depth."""
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
"""[m/s] Modelled depth rate below which a vehicle turns or flies level"""
LASTS = 300.0
"""[s] Correlation time of the water's vertical velocity: internal waves near the buoyancy period"""
LIKELY = 0.15
"""[1] Prior standard deviation of a factor: 100 g of ballast error in 200 g"""
LOWEST, HIGHEST = 0.6, 1.6
"""[1] Limits of a factor; a factor beyond them is no ballast error but another vehicle"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PhaseSpeed:
    """Factors from modelled to observed speed."""

    descent: float
    """[1] Factor in descents"""
    climb: float
    """[1] Factor in climbs"""

    def scaled(self, dive: FlownDive) -> Array:
        """Scaled velocity north, east [m/s], (time, 2); turns get interpolated factors."""
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
    """Estimate the phase speeds from one deployment's dives; 1 if the data are too short.

    Args:
      dives: dives whose velocity comes from a flight model.
      period: [s] between samples.
    """
    return PhaseSpeed(
        descent=_factor(dives, period, 1.0, "descending"),
        climb=_factor(dives, period, -1.0, "ascending"),
    )


def _factor(dives: Sequence[FlownDive], period: float, sign: float, phase: str) -> float:
    """Ratio of observed to modelled depth rate, shrunk to 1 by the water's own motion."""
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
