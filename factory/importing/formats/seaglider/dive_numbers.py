"""Dive numbers of a Seaglider: what the table of its dives says of each, fixes among it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factory.importing.reading.deployment_log import (
    EMPTY,
    NO_FIXES,
    Channel,
    Fixes,
)
from factory.importing.reading.tally import Tally
from factory.importing.repairs.cleaning import (
    positions,
)

Array = NDArray[np.float64]
Columns = dict[str, Array]


def first_time(dives: Columns) -> Array:
    """[s] unix time of each dive's first fix."""
    for name in ("gps2_time", "gps1_time", "gpsE_time"):
        if name in dives:
            return dives[name]
    return np.full(len(next(iter(dives.values()))), np.nan)


def per_dive(dives: Columns, name: str, *, at: str | None = None) -> Channel:
    """A number of each dive at the dive's fix."""
    if name not in dives:
        return EMPTY
    time = dives[at] if at in dives else first_time(dives)
    there = np.isfinite(time) & np.isfinite(dives[name])
    unique, first = np.unique(time[there], return_index=True)
    return Channel(unique, dives[name][there][first])


def dive_fixes(dives: Columns, name: str, tally: Tally) -> Fixes:
    """The three fixes of each dive."""
    times, latitudes, longitudes = [], [], []
    for fix in ("gps1", "gps2", "gpsE"):
        if all(f"{fix}_{part}" in dives for part in ("time", "lat", "lon")):
            times.append(dives[f"{fix}_time"])
            latitudes.append(dives[f"{fix}_lat"])
            longitudes.append(dives[f"{fix}_lon"])
    if not times:
        return NO_FIXES
    time = np.concatenate(times)
    latitude, longitude = positions(
        np.concatenate(latitudes), np.concatenate(longitudes), f"{name} GPS fixes", tally
    )
    lacking = ~(np.isfinite(time) & np.isfinite(latitude) & np.isfinite(longitude))
    tally.add("missing", f"{name} GPS fixes", int(lacking.sum()), "fixes without time or position")
    time, latitude, longitude = time[~lacking], latitude[~lacking], longitude[~lacking]
    # the fix after a dive is also the first one of the next
    unique, first = np.unique(time, return_index=True)
    return Fixes(unique, latitude[first], longitude[first])
