"""Water: temperature, salinity, density and oxygen of an OG1.0 file.

Heading of an OG1.0 file from true north, and where its magnetic variation comes from.
Places: fixes, tracks, waypoints and dive numbers of an OG1.0 file.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.flight_terms import LITRES, potential_density
from factory.exporting.og1.og1_terms import (
    ASCENT,
    DESCENT,
    INFLECTION,
    SURFACING,
)
from factory.exporting.og1.variables import ESTIMATED
from factory.importing.angles import reference_declination
from factory.importing.cleaning import positions
from factory.importing.deployment_log import (
    EMPTY,
    NO_FIXES,
    Channel,
    LoggedFixes,
)
from factory.importing.formats.og1.vocabulary import (
    CONDUCTIVITIES,
    CORRECTED,
    CURRENTS,
    DEPLOYED,
    DIMENSION,
    DIVES,
    OWN_TRACK,
    RECKONED,
    SALINITIES,
    TEMPERATURES,
    TRUE_TRACK,
    WAYPOINT,
    flags_of,
    without_bad,
)
from factory.importing.netcdf import (
    as_array,
    attributes_of,
    seconds_of,
    unit_in,
)
from factory.importing.seawater import ctd_channels, pressure_of, siemens
from factory.importing.tally import Tally, leave_out
from factory.importing.units import in_unit, is_of
from twin.errors import InputError

Array = NDArray[np.float64]


def ctd(
    time: Array,
    columns: Mapping[str, Array],
    channels: Mapping[str, Channel],
    fixes: LoggedFixes,
    tally: Tally,
    *,
    own_conductivity: bool,
) -> tuple[dict[str, Channel], set[str]]:
    """Temperature, salinity and density, and the names that they come from.

    With `own_conductivity` also the conductivity, which was measured and not made of the others.
    """

    def first(names: Sequence[str]) -> Array | None:
        found = next((n for n in names if n in columns and np.isfinite(columns[n]).any()), None)
        used.update([found] if found else [])
        return columns[found] if found else None

    used: set[str] = set()
    at = channels.get("measured_pressure") or channels.get("measured_depth") or EMPTY
    temperature = first(TEMPERATURES) if len(at) else None
    if temperature is None:
        return {}, used
    practical = first(SALINITIES)
    read = set(used)
    measured = first(CONDUCTIVITIES)
    if practical is not None and not own_conductivity:
        used = read  # it tells only where the CTD was off
    if measured is not None:
        measured = siemens(measured, "CNDC", tally)
    latitude, longitude = columns.get("LATITUDE"), columns.get("LONGITUDE")
    places = fixes
    if not len(fixes) and latitude is not None and longitude is not None:
        there = np.isfinite(latitude) & np.isfinite(longitude)
        places = LoggedFixes(time[there], latitude[there], longitude[there])
    north, east = places.at(time)
    water = ctd_channels(
        time,
        temperature=temperature,
        pressure=at.known(time),
        practical=practical,
        conductivity=measured,
        latitude=north,
        longitude=east,
        tally=tally,
    )
    if measured is not None and own_conductivity:
        there = np.isfinite(measured)
        water["measured_conductivity"] = Channel(time[there], measured[there])
    return water, used


def oxygen_per_volume(
    oxygen: Channel,
    attributes: Mapping[str, Any],
    name: str,
    water: Mapping[str, Channel],
    pressure: Channel,
    tally: Tally,
) -> Channel:
    """Dissolved oxygen [umol L-1]; per mass it is turned by the potential density of the sample.

    Without salinity and temperature nobody knows it per volume: left out, and told.
    """
    unit = unit_in(attributes)
    if not is_of(unit, "umol kg-1"):
        return oxygen
    known = [water.get(n, EMPTY) for n in ("measured_salinity", "measured_temperature")]
    if not all(len(one) for one in known) or not len(pressure):
        leave_out([name], "per mass of water, without salinity and temperature beside it", tally)
        return EMPTY
    dense = potential_density(*(one.at(oxygen.time) for one in (*known, pressure)))
    tally.add("note", name, len(oxygen), "umol/kg, kept as umol/L by its potential density")
    values = in_unit(oxygen.values, unit, "umol kg-1", name)
    return Channel(oxygen.time, values * dense / LITRES)


@dataclasses.dataclass(frozen=True)
class Variation:
    """Where the magnetic variation comes from."""

    given: float | None
    """[degree] By the user."""
    places: LoggedFixes
    """Where the vehicle was: its fixes, else its own track."""
    deployment: str
    stored: Channel
    """[degree] By the file."""

    def at(self, time: Array, tally: Tally) -> Array | None:
        """[degree] east positive: the user's, the file's or the field's; None without a place."""
        if self.given is not None:
            return np.full(len(time), self.given)
        if len(self.stored):
            return self.stored.at(time)
        found = reference_declination(self.places, self.deployment, tally)
        return found.at(time) if len(found) else None


def true_heading(
    values: Array,
    time: Array,
    attributes: Mapping[str, Any],
    variation: Variation,
    path: Path,
    tally: Tally,
) -> tuple[Array, Channel]:
    """Heading from true north, and the variation that was added.

    A variable that calls itself magnetic needs one; others are true unless the user gives one.
    """
    words = " ".join(str(attributes.get(k, "")) for k in ("long_name", "comment", "standard_name"))
    if "magnetic" in words.lower():
        known = variation.at(time, tally)
        if known is None:
            raise InputError(
                f"{path.name}: HEADING is magnetic by its description, and no position is there "
                "from which the variation follows; give it with --variation-deg, east positive"
            )
        return np.mod(values + known, 360.0), Channel(time, known)
    if variation.given is not None:
        known = np.full(len(time), variation.given)
        return np.mod(values + known, 360.0), Channel(time, known)
    if len(variation.stored):  # the heading contains it
        return np.mod(values, 360.0), variation.stored
    tally.add("note", "measured_heading", len(values), "taken as true: the file does not say else")
    return np.mod(values, 360.0), EMPTY


def fixes_in(time: Array, columns: Mapping[str, Array], tally: Tally) -> LoggedFixes:
    """The GPS fixes, each once."""
    if not all(name in columns for name in ("LATITUDE_GPS", "LONGITUDE_GPS")):
        return NO_FIXES
    if RECKONED in columns and CORRECTED not in columns:
        reckoned = (columns[RECKONED] == 1.0) & (columns["TIME_GPS"] == time)
        reckoned &= np.isfinite(columns["LATITUDE_GPS"])
        tally.add("removed", "GPS fixes", int(reckoned.sum()), f"reckoned, says {RECKONED}")
        latitude = np.where(reckoned, np.nan, columns["LATITUDE_GPS"])
        columns = {**columns, "LATITUDE_GPS": latitude}
    latitude, longitude = positions(
        columns["LATITUDE_GPS"], columns["LONGITUDE_GPS"], "GPS fixes", tally
    )
    time = columns["TIME_GPS"]
    good = np.isfinite(time) & np.isfinite(latitude) & np.isfinite(longitude)
    # a fix that is repeated at the following measurements is one fix
    unique, first = np.unique(time[good], return_index=True)
    return LoggedFixes(unique, latitude[good][first], longitude[good][first])


def fixes_apart(variables: Mapping[str, Any], name: str, tally: Tally) -> LoggedFixes:
    """The GPS fixes of a file that has them along a dimension of their own; none of another.

    Raises:
      InputError: their times are no dates of a log.
    """
    there = [one for one in ("TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS") if one in variables]
    dimensions = {variables[one].dimensions for one in there}
    if len(there) < 3 or len(dimensions) != 1 or dimensions & {(), (DIMENSION,)}:
        return NO_FIXES
    columns = {one: as_array(variables[one][:]) for one in there}
    flags = flags_of(variables, columns)
    columns = {one: without_bad(one, values, flags, tally) for one, values in columns.items()}
    described = attributes_of(variables["TIME_GPS"])
    time = seconds_of(columns["TIME_GPS"], described, name, tally)
    return fixes_in(time, {**columns, "TIME_GPS": time}, tally)


def deployed(variables: Mapping[str, Any]) -> LoggedFixes:
    """Where and when the deployment began, as an export writes it; none where it does not say.

    A simulated vehicle knows its origin before it has a fix.
    """
    if not all(name in variables for name in DEPLOYED):
        return NO_FIXES
    values = [as_array(variables[name][...]) for name in DEPLOYED]
    if any(len(one) != 1 or not np.isfinite(one).all() for one in values):
        return NO_FIXES
    return LoggedFixes(*values)


def with_start(fixes: LoggedFixes, start: LoggedFixes) -> LoggedFixes:
    """The fixes, and the start where it is earlier than all of them."""
    if not len(start) or (len(fixes) and fixes.time[0] <= start.time[0]):
        return fixes
    return LoggedFixes(
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
    time: Array, columns: Mapping[str, Array], fixes: LoggedFixes, tally: Tally
) -> dict[str, Channel]:
    """Numbers of the dives, and the reported current at the fix that ends each."""
    found: dict[str, Channel] = {}
    numbers = next((columns[n] for n in DIVES if n in columns), None)
    if numbers is not None:
        there = np.isfinite(numbers)
        found["dive"] = Channel(time[there], numbers[there])
    else:  # a current is one value for its dive
        said = [columns[n] for n in CURRENTS.values() if n in columns]
        stays = np.searchsorted(fixes.time, time).astype(np.float64)
        numbers = _stretches([*said, stays], len(time))
        there = np.ones(len(time), bool)
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


def _stretches(columns: Sequence[Array], count: int) -> Array:
    """Number of the stretch of rows with one value in each column, (count,); rows without a value
    belong to the stretch before them."""
    changes = np.zeros(count, bool)
    for values in columns:
        known = np.flatnonzero(np.isfinite(values))
        changes[known[1:]] |= np.diff(values[known]) != 0.0
    return np.cumsum(changes).astype(np.float64)


STORED = ("gap_stored", "phase_stored")
"""Columns that are made here"""

_PHASES = {SURFACING: 0.0, DESCENT: 1.0, ASCENT: 2.0, INFLECTION: 3.0}
"""The format's codes and those of `measured_phase`"""


def stored_columns(columns: Mapping[str, Array], flags: Mapping[str, Array]) -> dict[str, Array]:
    """Gaps and phases of the store, and pressure where only the depth beside a gap is written.

    Args:
      columns: of the file, (samples,) each.
      flags: of the variables that have some.
    """
    found = {}
    depth = columns.get("DEPTH")
    if "DEPTH" in flags:
        found["gap_stored"] = (flags["DEPTH"] == ESTIMATED).astype(float)
    if "PHASE" in columns:
        phase = np.full(len(columns["PHASE"]), np.nan)
        for code, flag in _PHASES.items():
            phase[columns["PHASE"] == code] = flag
        found["phase_stored"] = phase
    pressure, latitude = columns.get("PRES"), columns.get("LATITUDE_GPS")
    if depth is not None and pressure is not None and np.isnan(pressure).any():
        known = latitude[np.isfinite(latitude)] if latitude is not None else np.zeros(0)
        place = float(np.median(known)) if known.size else 0.0
        found["PRES"] = np.where(np.isnan(pressure), pressure_of(depth, place), pressure)
    return found
