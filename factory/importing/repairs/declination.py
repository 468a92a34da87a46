"""Magnetic declination where a log has none: the reference field of the Earth at place and date."""

from __future__ import annotations

import datetime

import numpy as np
from numpy.typing import NDArray

from factory.importing.reading.deployment_log import EMPTY, Channel, Fixes
from factory.importing.reading.tally import Tally

Array = NDArray[np.float64]

_DAY = 86400.0
"""[s] The field is evaluated once a day: a glider moves some tens of kilometres in it."""
FIRST, LAST = datetime.datetime(1900, 1, 1), datetime.datetime(2030, 1, 1)
"""What IGRF-14 covers."""


def reference_declination(places: Fixes, subject: str, tally: Tally) -> Channel:
    """Declination [degree], east positive, by IGRF-14 at sea level; empty without a position.

    One value for each day with positions, at their median.

    Args:
      places: where the vehicle was: its fixes, or its own track.
      subject: the deployment, for the report.
    """
    if not len(places):
        return EMPTY
    import ppigrf

    days = np.floor(places.time / _DAY)
    times, values = [], []
    for day in np.unique(days):
        here = days == day
        date = datetime.datetime.fromtimestamp((day + 0.5) * _DAY, datetime.UTC)
        east, north, _ = ppigrf.igrf(
            float(np.median(places.longitude[here])), float(np.median(places.latitude[here])), 0.0,
            min(max(date.replace(tzinfo=None), FIRST), LAST),
        )  # fmt: skip
        times.append(float(np.median(places.time[here])))
        values.append(float(np.degrees(np.arctan2(np.ravel(east)[0], np.ravel(north)[0]))))
    low, high = min(values), max(values)
    size = f"{low:.2f}" if high - low < 0.01 else f"{low:.2f} to {high:.2f}"
    tally.add(
        "note", "magnetic variation", 1,
        f"{subject}: the log has none; {size} degree by IGRF-14 at its place and date",
    )  # fmt: skip
    return Channel(np.array(times), np.array(values))
