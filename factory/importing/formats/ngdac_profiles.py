"""Profiles of NGDAC files: the place of each among the samples, and the current of its segment."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import Channel, LoggedFixes

Array = NDArray[np.float64]
Columns = dict[str, Array]
Number = NDArray[np.intp]

CURRENT = ("u", "v")
"""[m/s] of the segment, eastward and northward"""
STANDARD = {
    "pressure": "sea_water_pressure", "depth": "depth", "temperature": "sea_water_temperature",
    "salinity": "sea_water_practical_salinity",
    "conductivity": "sea_water_electrical_conductivity", "lat": "latitude", "lon": "longitude",
}  # fmt: skip
"""CF's standard names of variables that other assemblies call otherwise"""
_NONE = -np.inf
"""Stands for NaN where profiles are compared, which differs from itself"""


def by_standard_name(variables: Mapping[str, Any], known: Collection[str]) -> dict[str, str]:
    """Names of a file's variables by ours, of those that it calls otherwise; where several have
    the standard name, known ones among them, none.

    Args:
      known: names that are read anyway.
    """
    found = {}
    for ours, standard in STANDARD.items():
        there = [
            name for name, variable in variables.items()
            if standard in (name, getattr(variable, "standard_name", ""))
        ]  # fmt: skip
        if ours not in variables and len(there) == 1 and there[0] not in known:
            found[ours] = there[0]
    return found


def profile_numbers(count: int, keys: Sequence[Array]) -> Number:
    """Profile of each sample, counted from 0, by what is one value for all samples of a profile.

    Args:
      count: of samples.
      keys: such values at the samples, (samples,) each.
    """
    if not keys:
        return np.zeros(count, np.intp)
    table = np.stack([np.where(np.isnan(key), _NONE, key) for key in keys], axis=1)
    return np.unique(table, axis=0, return_inverse=True)[1].reshape(count)


def place_once(columns: Columns, pair: Sequence[str], when: Array, time: Array) -> None:
    """Keep a profile's position at one sample of it, in place.

    Args:
      columns: with the two of the pair at each sample.
      when: [s] unix, time of the profile, (samples,); NaN: unknown, the middle of its samples.
      time: [s] unix, of each sample.
    """
    values = [columns[name] for name in pair]
    number = profile_numbers(len(time), [*values, when])
    kept = np.zeros(len(time), bool)
    for one in np.unique(number):
        rows = np.flatnonzero((number == one) & np.isfinite(time))
        if rows.size:
            middle = when[rows[0]] if np.isfinite(when[rows[0]]) else float(np.median(time[rows]))
            kept[rows[np.argmin(np.abs(time[rows] - middle))]] = True
    for name, value in zip(pair, values, strict=True):
        columns[name] = np.where(kept, value, np.nan)


def currents_of(
    columns: Mapping[str, Array], number: Number, time: Array
) -> list[tuple[float, float, float]]:
    """End of each profile [s] unix, and its segment's current eastward and northward [m/s]; NaN
    where it has none.

    Args:
      columns: at the samples, `u` and `v` among them where the file has them.
      number: profile of each sample.
      time: [s] unix, of each sample.
    """
    found = []
    unknown = np.full(len(time), np.nan)
    east, north = (columns.get(name, unknown) for name in CURRENT)
    both = np.isfinite(east) & np.isfinite(north)
    for one in np.unique(number):
        rows = np.flatnonzero((number == one) & np.isfinite(time))
        if rows.size:
            said = rows[both[rows]]
            values = (float(east[said[0]]), float(north[said[0]])) if said.size else (np.nan,) * 2
            found.append((float(time[rows].max()), *values))
    return found


def reported_currents(
    profiles: Sequence[tuple[float, float, float]], fixes: LoggedFixes
) -> dict[str, Channel]:
    """Current that each profile reports, at its end and at the fixes up to the end of the next.

    The vehicle knows it when it has surfaced, where the row of its dive ends: with the profile's
    last sample, or with a fix after that.

    Args:
      profiles: as of `currents_of`, of all files.
    """
    end, east, north = (np.array(part, np.float64) for part in zip(*sorted(profiles), strict=True))
    time = np.union1d(end, fixes.time[fixes.time > end[0]])
    at = np.searchsorted(end, time, side="right") - 1
    known = np.isfinite(east[at])
    if not known.any():
        return {}
    return {
        "dac_east": Channel(time[known], east[at][known]),
        "dac_north": Channel(time[known], north[at][known]),
    }
