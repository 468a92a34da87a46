"""SeaExplorer reader: logs of navigation (gli) and payload (pld), with commas or semicolons.

Native: degrees, magnetic heading with a column of declination, depth in m, positions as NMEA
ddmm.mmm, ballast in cm3 (+ = lighter), pitch mass in mm forward, roll mass in degree (+ rolls to
starboard). A position is a GPS fix if it differs from the row before, as the log repeats the last
one, and the column DeadReckoning is 0. In logs without that column the state must be 116 (at the
surface, transmitting). Beam velocities of a payload's AD2CP are left out: without their transform
and a reference layer they are no velocity through the water.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import FLYING, from_degrees, heading_degrees, reference_declination
from factory.importing.cleaning import clean, degrees_minutes
from factory.importing.columns import Table, read_table, stacked, tidy, with_values
from factory.importing.deployment_log import (
    NEAR,
    NO_FIXES,
    TRUNCATED,
    Channel,
    DeploymentLog,
    LoggedFixes,
    each_file,
    places_for,
)
from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.payload import payload_channels, payload_names
from factory.importing.pressures import SEA_LEVEL, ctd_channels, pressure_of, siemens
from factory.importing.sample_clock import expect_going, parse_stamps, unix_seconds
from factory.importing.tally import OtherKind, Tally, leave_out, note_empty, note_unread
from factory.importing.units import in_unit
from twin.errors import InputError
from twin.records.coordinates import utc_minute

Array = NDArray[np.float64]
Columns = dict[str, Array]

MM = 1e-3
"""[m] One millimetre."""
AT_SURFACE = 116
"""NavState of a glider that is at the surface and has its fixes."""
NO_VALUE = -999.0
"""Commands and sensors at or below this are switched off (-9999)."""
_NAVIGATION = (
    "NavState", "Heading", "Declination", "Pitch", "Roll", "Depth", "Lat", "Lon", "DeadReckoning",
    "DesiredH", "BallastCmd", "BallastPos", "LinCmd", "LinPos", "AngCmd", "AngPos", "Voltage", "Pa",
)  # fmt: skip
_SIMPLE = (
    ("Roll", "measured_roll", 1.0),
    ("BallastPos", "measured_pump", 1.0),
    ("BallastCmd", "commanded_pump", 1.0),
    ("LinPos", "measured_shift", MM),
    ("LinCmd", "commanded_shift", MM),
    # the mass turns to starboard for positive angles, ours to port
    ("AngPos", "measured_rotation", -1.0),
    ("AngCmd", "commanded_rotation", -1.0),
    ("Voltage", "measured_voltage", 1.0),
)
_CTDS = ("LEGATO", "GPCTD", "CTD")
"""Prefixes of the CTDs that payloads carry."""
_CTD_PARTS = ("TEMPERATURE", "SALINITY", "CONDUCTIVITY", "PRESSURE")
_CTD_NAMES = tuple(f"{prefix}_{part}" for prefix in _CTDS for part in _CTD_PARTS)
_NAVIGATION_LOG, _PAYLOAD_LOG = "navigation log", "payload log"
_CONDUCTIVITY = {"LEGATO": "mS/cm", "GPCTD": "S/m", "CTD": "mS/cm"}
"""Unit of each CTD's conductivity: RBR's in mS/cm, Sea-Bird's in S/m."""
_DEPLOYMENT = re.compile(r"(sea\d+)[._-]?m?(\d+)", re.IGNORECASE)


def read_seaexplorer(
    paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:
    """Make one log for each vehicle and mission among the files.

    Raises:
      WrongFormat: a file is of another kind.
      InputError: no navigation log is among the files.
    """
    logs: dict[str, dict[str, list[Columns]]] = {_NAVIGATION_LOG: {}, _PAYLOAD_LOG: {}}
    files: dict[str, list[str]] = {}
    wanted = {
        _NAVIGATION_LOG: ("Timestamp", *_NAVIGATION),
        _PAYLOAD_LOG: ("PLD_REALTIMECLOCK", *_CTD_NAMES, *payload_names(options.payload)),
    }
    empty: dict[str, set[str]] = {what: set(names) for what, names in wanted.items()}
    for path, (what, table, columns) in each_file(paths, lambda p: _timed_table(p, tally), tally):
        name = deployment_of(path)
        logs[what].setdefault(name, []).append(columns)
        files.setdefault(name, []).append(path.name)
        tally.add("read", path.name, len(table), f"{what.split()[0]} rows")
        note_unread(what, [*table.columns, *table.texts], wanted[what], tally)
        empty[what] -= {*with_values(table.columns), *table.texts}
    for what, names in empty.items():
        note_empty(what, names, tally)
    navigation, payload = logs.values()
    for name in [name for name in payload if name not in navigation]:
        why = (
            f"{files[name][0]}: a payload log without the navigation log (gli) of {name}; "
            f"navigation logs are there of {', '.join(navigation) or 'no vehicle'}"
        )
        if not navigation:
            raise InputError(why)
        tally.add("left out", name, len(files[name]), why)
    return [
        _log(name, pieces, payload.get(name, []), files[name], options, tally)
        for name, pieces in navigation.items()
    ]


def _timed_table(path: Path, tally: Tally) -> tuple[str, Table, Columns]:
    """Kind of a file's log, its table, and its numbers with their time.

    Raises:
      WrongFormat: the file is of another kind.
      InputError: the file cannot be read, is empty, or has no times.
    """
    if "evt" in path.name.lower().split("."):
        raise OtherKind(f"{path.name} is the vehicle's list of events: texts, no measurements")
    table = read_table(path)
    names = [*table.columns, *table.texts]
    if "NavState" in table.columns and "Timestamp" in names:
        what, clock = _NAVIGATION_LOG, "Timestamp"
    elif "PLD_REALTIMECLOCK" in names:
        what, clock = _PAYLOAD_LOG, "PLD_REALTIMECLOCK"
    else:
        raise WrongFormat(path, names)
    if not len(table):
        raise InputError(f"{path.name} holds column names and no rows")
    written = table.texts.get(clock)
    time = parse_stamps(written) if written is not None else table.columns[clock]
    if not np.isfinite(time).any():
        raise InputError(f"{path.name}: column {clock} holds no time (day/month/year h:m:s)")
    time = unix_seconds(time, path.name, tally)
    columns = {"time": time, **table.columns}
    expect_going(clock, columns["time"], table.columns, path.name)
    return what, table, columns


def deployment_of(path: Path) -> str:
    """Vehicle and mission by the file's name, such as SEA035_M12; else the name itself."""
    found = _DEPLOYMENT.match(path.name)
    return f"{found.group(1).upper()}_M{found.group(2)}" if found else path.name.split(".")[0]


def _log(
    name: str,
    pieces: Sequence[Columns],
    payload: Sequence[Columns],
    files: Sequence[str],
    options: ReadOptions,
    tally: Tally,
) -> DeploymentLog:
    columns = stacked(pieces, ("time", *_NAVIGATION))
    time, columns = tidy(columns.pop("time"), columns, f"{name} navigation", tally)
    if not time.size:
        raise InputError(f"{name}: no row has a time")
    for column in [column for column in columns if column not in ("Lat", "Lon")]:
        off = columns[column] <= NO_VALUE
        columns[column] = tally.removed(columns[column], off, column, "switched off (-9999)")
    fixes, track = _positions(time, columns, tally)
    places = places_for(fixes, track)
    variation = _variation(time, columns, places, name, options.variation_deg, tally)
    channels: dict[str, Channel] = {}

    def put(target: str, values: Array, source: str) -> None:
        channels[target] = clean(target, time, values, tally, subject=source)

    depth = columns.get("Depth", np.full(len(time), np.nan))
    put("measured_depth", depth, "Depth")
    if "Pitch" in columns:
        flying = bool(np.nanmax(depth, initial=0.0) > FLYING)
        put(
            "measured_pitch", from_degrees(columns["Pitch"], "Pitch", tally, flying=flying), "Pitch"
        )
    for source, target, factor in _SIMPLE:
        if source in columns:
            put(target, factor * columns[source], source)
    if "Pa" in columns:
        put("measured_vacuum", SEA_LEVEL - columns["Pa"], "Pa")
    for source, target in (("Heading", "measured_heading"), ("DesiredH", "commanded_heading")):
        if source in columns:
            if not len(variation):
                raise InputError(
                    f"{name}: {source} is magnetic and the log has no Declination and no position "
                    "from which it follows; give it with --variation-deg, east positive"
                )
            magnetic = heading_degrees(columns[source], source, tally)
            put(target, np.mod(magnetic + variation.at(time), 360.0), source)
    auxiliary = {**track, "awake": Channel(time, np.ones(len(time)))}
    if "NavState" in columns:
        floats = time[columns["NavState"] == AT_SURFACE]
        auxiliary["afloat"] = Channel(floats, np.ones(len(floats)))
    channels |= _payload(payload, channels["measured_depth"], fixes, name, options, tally)
    return DeploymentLog(
        deployment=name,
        platform="SeaExplorer",
        channels=channels,
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary=auxiliary,
        files=tuple(files),
    )


def _variation(
    time: Array,
    columns: Columns,
    places: LoggedFixes,
    name: str,
    variation_deg: float | None,
    tally: Tally,
) -> Channel:
    """Declination [degree], east positive; zeros before a glider's first fix are dropped."""
    if variation_deg is not None:
        if "Declination" in columns:
            leave_out(["Declination"], "the user gives the variation", tally)
        return Channel(time[:1], np.array([variation_deg]))
    values = columns.get("Declination", np.full(len(time), np.nan))
    wrong = np.isfinite(values) & ~(np.abs(values) <= 180.0)
    values = tally.removed(values, wrong, "Declination", "no declination: beyond 180 degree")
    unset = values == 0.0
    known = np.isfinite(values) & ~unset
    if not known.any():
        found = reference_declination(places, name, tally)
        return found if len(found) else Channel.finite(time, values)
    tally.add("repaired", "Declination", unset, "not set yet (0): the nearest used")
    return Channel(time[known], values[known])


def _positions(
    time: Array, columns: Columns, tally: Tally
) -> tuple[LoggedFixes, dict[str, Channel]]:
    """Fixes, and the on-board track if the vehicle dead-reckons under water."""
    if not all(name in columns for name in ("Lat", "Lon", "NavState")):
        return NO_FIXES, {}
    latitude, longitude = columns["Lat"], columns["Lon"]
    none = (latitude == 0.0) & (longitude == 0.0)
    tally.add("removed", "Lat, Lon", none, "no position yet (0, 0)")
    moved = np.zeros(len(time), bool)
    moved[1:] = (np.diff(latitude) != 0.0) | (np.diff(longitude) != 0.0)
    if np.nanmax(np.abs(latitude), initial=0.0) <= 90.0 and (
        np.nanmax(np.abs(longitude), initial=0.0) <= 180.0
    ):
        tally.add("repaired", "Lat, Lon", ~none, "was in degrees, not ddmm.mmm")
    else:
        latitude, longitude = degrees_minutes(latitude), degrees_minutes(longitude)
    good = ~none & (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0)
    surfaced = columns["NavState"] == AT_SURFACE
    reckons = columns.get("DeadReckoning", np.full(len(time), np.nan))
    if (reckons == 0.0).any() and (reckons > 0.0).any():
        surfaced = np.where(np.isfinite(reckons), reckons == 0.0, surfaced)
        # the first row of a log has no row before it to repeat
        moved[:1] = reckons[:1] == 0.0
    else:  # a column that never changes says nothing
        surfaced = surfaced & ~(reckons > 0.0)
    tally.add(
        "left out", "GPS fixes", good & surfaced & ~moved, "the last position again, no new fix"
    )
    places = LoggedFixes(time, latitude, longitude)
    reckoned = good & moved & ~surfaced
    track = {} if reckoned.sum() < 0.2 * len(time) else places.keep(good).channels()
    return places.keep(good & surfaced & moved), track


def _payload(
    pieces: Sequence[Columns],
    depth: Channel,
    fixes: LoggedFixes,
    name: str,
    options: ReadOptions,
    tally: Tally,
) -> dict[str, Channel]:
    """Temperature, salinity and density of the payload's CTD, and its other signals."""
    if not pieces:
        return {}
    every = sorted({column for piece in pieces for column in piece if column != "time"})
    if any(column.startswith("AD2CP_V") for column in every):
        beams = sum(int(np.isfinite(p.get("AD2CP_V1_CN1", np.zeros(0))).sum()) for p in pieces)
        tally.add("left out", "AD2CP", beams, "beam velocities: no velocity through the water")
    wanted = (*_CTD_NAMES, *payload_names(options.payload))
    columns = stacked(pieces, ("time", *(n for n in every if n in wanted)))
    subject = f"{name} payload"
    time, columns = tidy(columns.pop("time"), columns, subject, tally)
    columns = with_values(columns)
    if len(depth):
        began, ended = (float(depth.time[k]) for k in (0, -1))
        why = f"rows from before the navigation log begins at {utc_minute(began)} UTC"
        tally.add("left out", subject, time < began - NEAR, why)
        why = f"{TRUNCATED}rows from after the navigation log ends at {utc_minute(ended)} UTC"
        tally.add("left out", subject, time > ended + NEAR, why)
    found = {n: Channel.finite(time, v) for n, v in columns.items()}
    channels = payload_channels(found, options.payload, tally)
    ctd = next((c for c in _CTDS if f"{c}_TEMPERATURE" in found), None)
    if ctd is None:
        return channels
    others = [n for n in _CTD_NAMES if n in columns and not n.startswith(f"{ctd}_")]
    leave_out(others, f"the CTD is {ctd}", tally)
    latitude, longitude = fixes.middle
    temperature, practical, conductivity, pressure = (
        columns.get(f"{ctd}_{part}") for part in _CTD_PARTS
    )
    assert temperature is not None
    if conductivity is not None:
        source = f"{ctd}_CONDUCTIVITY"
        conductivity = in_unit(conductivity, _CONDUCTIVITY[ctd], "S m-1", source)
        conductivity = siemens(conductivity, source, tally)
        if practical is not None:
            leave_out([source], f"{ctd}_SALINITY is there", tally)
    if pressure is None:
        pressure = pressure_of(depth.known(time), latitude)
    return channels | ctd_channels(
        time, temperature=temperature, pressure=pressure, practical=practical,
        conductivity=conductivity, latitude=latitude, longitude=longitude, tally=tally,
    )  # fmt: skip
