"""Summary: what the vertical velocity of the water says of a flight model.

The ocean rises and sinks as often in dives as in climbs: their means part where the model errs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from twin.flight.dive import FlownDive

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
