"""Last fix: where a vehicle was known to be last, by its log."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from glider_twin_ops.forecast import LoggedLeg
from twin.geodesy import position
from twin.records import LogStore
from twin.records.attributes import DIVE_DURATION
from twin.show.dates import moment_of


def end_of(leg: LoggedLeg) -> tuple[float, float]:
    """Latitude, longitude [degree] of the fix after a dive."""
    north, east = (np.array([metres]) for metres in leg.leg.over_ground)
    latitude, longitude = position(north, east, *leg.begin)
    return float(latitude[0]), float(longitude[0])


@dataclasses.dataclass(frozen=True, kw_only=True)
class LastFix:
    """Where it was known to be last."""

    latitude: float
    """[degree]"""
    longitude: float
    """[degree]"""
    time: float
    """[s] unix"""

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        return {
            "latitude": round(self.latitude, 6),
            "longitude": round(self.longitude, 6),
            "time": f"{moment_of(self.time):%Y-%m-%dT%H:%M:%SZ}",
        }


def newest_fix(logs: LogStore, rows: Sequence[int]) -> LastFix | None:
    """The newest fix after one of these dives."""
    for row in reversed(rows):
        latitude, longitude = logs.fixes(row)[1]
        end = float(logs.starts[row] + logs.number(DIVE_DURATION)[row])
        if math.isfinite(latitude) and math.isfinite(longitude) and math.isfinite(end):
            return LastFix(latitude=float(latitude), longitude=float(longitude), time=end)
    return None
