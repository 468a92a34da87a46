"""Derived channels of an OG1.0 file: water, true heading, positions and dives.

Water is temperature, salinity, density and oxygen. Positions are fixes, tracks and waypoints.
`Variation` chooses the magnetic variation of the user, the file or the reference field.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.flight_terms import LITRES, potential_density
from factory.exporting.og1.og1_terms import ASCENT, DESCENT, INFLECTION, SURFACING
from factory.exporting.og1.variables import ESTIMATED
from factory.importing.angles import calls_itself_magnetic, reference_declination
from factory.importing.cleaning import positions
from factory.importing.deployment_log import EMPTY, NO_FIXES, Channel, LoggedFixes
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
from factory.importing.netcdf import as_array, attributes_of, seconds_of, unit_in
from factory.importing.pressures import ctd_channels, pressure_of, siemens
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
    """Temperature, salinity and density, and the names of the variables used.

    With `own_conductivity` also the conductivity: it was measured, not computed from the others.
    """
    names = [
        next((n for n in several if n in columns and np.isfinite(columns[n]).any()), "")
        for several in (TEMPERATURES, SALINITIES, CONDUCTIVITIES)
    ]
    temperature, practical, measured = (columns.get(name) for name in names)
    at = channels.get("measured_pressure") or channels.get("measured_depth") or EMPTY
    if temperature is None or not len(at):
        return {}, set()
    # with a salinity, conductivity shows only when the CTD was off
    used = set(names if practical is None or own_conductivity else names[:2])
    if measured is not None:
        measured = siemens(measured, "CNDC", tally)
    if not len(fixes) and {"LATITUDE", "LONGITUDE"} <= set(columns):
        fixes = LoggedFixes.finite(time, columns["LATITUDE"], columns["LONGITUDE"])
    north, east = fixes.at(time)
    water = ctd_channels(
        time, temperature=temperature, pressure=at.known(time), practical=practical,
        conductivity=measured, latitude=north, longitude=east, tally=tally,
    )  # fmt: skip
    if measured is not None and own_conductivity:
        water["measured_conductivity"] = Channel.finite(time, measured)
    return water, used


def oxygen_per_volume(
    oxygen: Channel,
    attributes: Mapping[str, Any],
    name: str,
    water: Mapping[str, Channel],
    pressure: Channel,
    tally: Tally,
) -> Channel:
    """Dissolved oxygen [umol L-1]; values per mass are converted by potential density.

    Without salinity and temperature, oxygen per mass is left out and reported.
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
    """Sources of the magnetic variation."""

    given: float | None
    """[degree] Variation given by the user."""
    places: LoggedFixes
    """Positions of the vehicle: its fixes, else its own track."""
    deployment: str
    stored: Channel
    """[degree] Variation in the file."""

    def at(self, time: Array, tally: Tally) -> Array | None:
        """[degree] Variation, east positive, by the user, the file or the field; else None."""
        if self.given is not None:
            return np.full(len(time), self.given)
        found = self.stored or reference_declination(self.places, self.deployment, tally)
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

    A variable described as magnetic needs a variation. Others are true unless the user gives one.
    """
    if variation.given is not None or calls_itself_magnetic(attributes):
        known = variation.at(time, tally)
        if known is None:
            raise InputError(
                f"{path.name}: HEADING is magnetic by its description, and no position is there "
                "from which the variation follows; give it with --variation-deg, east positive"
            )
        return np.mod(values + known, 360.0), Channel(time, known)
    if not len(variation.stored):  # otherwise the heading contains it
        why = "taken as true: the file does not say else"
        tally.add("note", "measured_heading", len(values), why)
    return np.mod(values, 360.0), variation.stored


def fixes_in(time: Array, columns: Mapping[str, Array], tally: Tally) -> LoggedFixes:
    """GPS fixes, each once."""
    latitude, longitude = (columns.get(name) for name in ("LATITUDE_GPS", "LONGITUDE_GPS"))
    if latitude is None or longitude is None:
        return NO_FIXES
    if RECKONED in columns and CORRECTED not in columns:
        reckoned = (columns[RECKONED] == 1.0) & (columns["TIME_GPS"] == time)
        reckoned &= np.isfinite(latitude)
        latitude = tally.removed(latitude, reckoned, "GPS fixes", f"reckoned, says {RECKONED}")
    latitude, longitude = positions(latitude, longitude, "GPS fixes", tally)
    # a fix that is repeated at the following measurements is one fix
    return LoggedFixes.finite(columns["TIME_GPS"], latitude, longitude).once()


def fixes_apart(variables: Mapping[str, Any], name: str, tally: Tally) -> LoggedFixes:
    """GPS fixes of a file that has them along a dimension of their own; else no fixes.

    Raises:
      InputError: the fixes' times are no dates of a log.
    """
    there = [one for one in ("TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS") if one in variables]
    dimensions = {variables[one].dimensions for one in there}
    if len(there) < 3 or len(dimensions) != 1 or dimensions & {(), (DIMENSION,)}:
        return NO_FIXES
    columns = {one: as_array(variables[one][:]) for one in there}
    flags = flags_of(variables, columns)
    columns = {one: without_bad(one, values, flags, tally) for one, values in columns.items()}
    described = attributes_of(variables["TIME_GPS"])
    columns["TIME_GPS"] = seconds_of(columns["TIME_GPS"], described, name, tally)
    return fixes_in(columns["TIME_GPS"], columns, tally)


def deployed(variables: Mapping[str, Any]) -> LoggedFixes:
    """Time and position of the deployment's start, as an export writes them; else no fixes.

    A simulated vehicle knows its origin before it has a fix.
    """
    values = [as_array(variables[name][...]) for name in DEPLOYED if name in variables]
    whole = len(values) == len(DEPLOYED) and all(len(one) == 1 for one in values)
    return LoggedFixes.finite(*values) if whole else NO_FIXES


def with_start(fixes: LoggedFixes, start: LoggedFixes) -> LoggedFixes:
    """Fixes, preceded by the start if it is earlier than all of them."""
    if not len(start) or (len(fixes) and fixes.time[0] <= start.time[0]):
        return fixes
    return LoggedFixes(
        np.append(start.time, fixes.time),
        np.append(start.latitude, fixes.latitude),
        np.append(start.longitude, fixes.longitude),
    )


def tracks_in(time: Array, columns: Mapping[str, Array], tally: Tally) -> dict[str, Channel]:
    """Tracks: the glider's own, its waypoints, and the true positions of a simulated glider."""
    names = OWN_TRACK
    if CORRECTED in columns:
        leave_out(["LATITUDE", "LONGITUDE"], "a track corrected at the fixes", tally)
    elif not set(names) <= set(columns):
        names = ("LATITUDE", "LONGITUDE")
    found: dict[str, Channel] = {}
    for prefix, pair in (("", names), ("waypoint_", WAYPOINT), ("true_", TRUE_TRACK)):
        if set(pair) <= set(columns):
            places = positions(columns[pair[0]], columns[pair[1]], ", ".join(pair), tally)
            track = LoggedFixes.finite(time, *places)
            found |= track.channels(prefix) if len(track) else {}
    return found


def dives_in(
    time: Array, columns: Mapping[str, Array], fixes: LoggedFixes, tally: Tally
) -> dict[str, Channel]:
    """Numbers of the dives, and each dive's reported current at the fix that ends the dive."""
    found: dict[str, Channel] = {}
    numbers = next((columns[n] for n in DIVES if n in columns), None)
    if numbers is not None:
        there = np.isfinite(numbers)
        found["dive"] = Channel(time[there], numbers[there])
    else:  # a dive has one value of the current
        said = [columns[n] for n in CURRENTS.values() if n in columns]
        stays = np.searchsorted(fixes.time, time).astype(np.float64)
        numbers = _stretches([*said, stays], len(time))
        there = np.ones(len(time), bool)
    for target, name in CURRENTS.items():
        if name not in columns:
            continue
        good = np.flatnonzero(there & np.isfinite(columns[name]))
        last = good[np.append(numbers[good][1:] != numbers[good][:-1], True)] if good.size else good
        at = time[last]
        if len(fixes):
            following = np.searchsorted(fixes.time, at)
            inside = following < len(fixes)
            at = np.where(inside, fixes.time[np.minimum(following, len(fixes) - 1)], at)
        unique, first = np.unique(at, return_index=True)
        found[target] = Channel(unique, columns[name][last][first])
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
"""Columns that `stored_columns` makes."""

_PHASES = {SURFACING: 0.0, DESCENT: 1.0, ASCENT: 2.0, INFLECTION: 3.0}
"""Flags of `measured_phase`, by the format's codes."""


def stored_columns(columns: Mapping[str, Array], flags: Mapping[str, Array]) -> dict[str, Array]:
    """Gaps and phases of the store, and pressure where a gap has only the depth.

    Args:
      columns: of the file, (samples,) each.
      flags: quality flags of the variables that have flags.
    """
    found = {}
    depth, pressure, phase = (columns.get(name) for name in ("DEPTH", "PRES", "PHASE"))
    if "DEPTH" in flags:
        found["gap_stored"] = (flags["DEPTH"] == ESTIMATED).astype(float)
    if phase is not None:
        found["phase_stored"] = np.full(len(phase), np.nan)
        for code, flag in _PHASES.items():
            found["phase_stored"][phase == code] = flag
    if depth is not None and pressure is not None and np.isnan(pressure).any():
        latitude = columns.get("LATITUDE_GPS", np.zeros(0))
        known = latitude[np.isfinite(latitude)]
        place = float(np.median(known)) if known.size else 0.0
        found["PRES"] = np.where(np.isnan(pressure), pressure_of(depth, place), pressure)
    return found
