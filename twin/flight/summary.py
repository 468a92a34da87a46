"""Summary: what the vertical velocity of the water says of a flight model.

The ocean rises and sinks as often in dives as in climbs: their means part where the model errs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from twin.flight.dive import FlownDive


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

    def describe(self) -> dict[str, float]:
        """The figures with their units in the names."""
        return {
            "w_mean_dive_m_s": self.w_mean_dive,
            "w_mean_climb_m_s": self.w_mean_climb,
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
    )


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if values.size else float("nan")
