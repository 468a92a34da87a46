"""Places: fixes, tracks, waypoints and dive numbers of an OG1.0 file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.formats.og1.names import (
    CORRECTED,
    CURRENTS,
    DEPLOYED,
    DIVES,
    OWN_TRACK,
    TRUE_TRACK,
    WAYPOINT,
)
from factory.importing.reading.deployment_log import NO_FIXES, Channel, Fixes
from factory.importing.reading.netcdf import as_array
from factory.importing.reading.tally import Tally
from factory.importing.reading.unread_names import leave_out
from factory.importing.repairs.cleaning import positions

Array = NDArray[np.float64]


def fixes_in(columns: Mapping[str, Array], tally: Tally) -> Fixes:
    """The GPS fixes, each once."""
    if not all(name in columns for name in ("LATITUDE_GPS", "LONGITUDE_GPS")):
        return NO_FIXES
    latitude, longitude = positions(
        columns["LATITUDE_GPS"], columns["LONGITUDE_GPS"], "GPS fixes", tally
    )
    time = columns["TIME_GPS"]
    good = np.isfinite(time) & np.isfinite(latitude) & np.isfinite(longitude)
    # a fix that is repeated at the following measurements is one fix
    unique, first = np.unique(time[good], return_index=True)
    return Fixes(unique, latitude[good][first], longitude[good][first])


def deployed(variables: Mapping[str, Any]) -> Fixes:
    """Where and when the deployment began, as an export writes it; none where it does not say.

    A simulated vehicle knows its origin before it has a fix.
    """
    if not all(name in variables for name in DEPLOYED):
        return NO_FIXES
    values = [as_array(variables[name][...]) for name in DEPLOYED]
    if any(len(one) != 1 or not np.isfinite(one).all() for one in values):
        return NO_FIXES
    return Fixes(*values)


def with_start(fixes: Fixes, start: Fixes) -> Fixes:
    """The fixes, and the start where it is earlier than all of them."""
    if not len(start) or (len(fixes) and fixes.time[0] <= start.time[0]):
        return fixes
    return Fixes(
        np.concatenate([start.time, fixes.time]),
        np.concatenate([start.latitude, fixes.latitude]),
        np.concatenate([start.longitude, fixes.longitude]),
    )


def tracks_in(time: Array, columns: Mapping[str, Array], tally: Tally) -> dict[str, Channel]:
    """The glider's own track, its waypoints, and where a simulated one really was."""
    names = OWN_TRACK
    if not all(name in columns for name in names):
        names = ("LATITUDE", "LONGITUDE")
    if CORRECTED in columns:
        leave_out(["LATITUDE", "LONGITUDE"], "a track corrected at the fixes", tally)
        names = OWN_TRACK
    found: dict[str, Channel] = {}
    for prefix, (first, second) in (("", names), ("waypoint_", WAYPOINT), ("true_", TRUE_TRACK)):
        if first not in columns or second not in columns:
            continue
        latitude, longitude = positions(
            columns[first], columns[second], f"{first}, {second}", tally
        )
        good = np.isfinite(latitude) & np.isfinite(longitude)
        if good.any():
            found[f"{prefix}latitude"] = Channel(time[good], latitude[good])
            found[f"{prefix}longitude"] = Channel(time[good], longitude[good])
    return found


def dives_in(
    time: Array, columns: Mapping[str, Array], fixes: Fixes, tally: Tally
) -> dict[str, Channel]:
    """Numbers of the dives, and the reported current at the fix that ends each."""
    found: dict[str, Channel] = {}
    numbers = next((columns[n] for n in DIVES if n in columns), None)
    if numbers is None:
        leave_out([n for n in CURRENTS.values() if n in columns], "no dive numbers", tally)
        return found
    there = np.isfinite(numbers)
    found["dive"] = Channel(time[there], numbers[there])
    for target, name in CURRENTS.items():
        if name not in columns:
            continue
        values = np.where(there, columns[name], np.nan)
        good = np.flatnonzero(np.isfinite(values))
        last = good[np.append(numbers[good][1:] != numbers[good][:-1], True)] if good.size else good
        at = time[last]
        if len(fixes):
            following = np.searchsorted(fixes.time, at)
            inside = following < len(fixes)
            at = np.where(inside, fixes.time[np.minimum(following, len(fixes) - 1)], at)
        unique, first = np.unique(at, return_index=True)
        found[target] = Channel(unique, values[last][first])
    return found
