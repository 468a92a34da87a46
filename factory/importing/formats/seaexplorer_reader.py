"""Reader of SeaExplorer logs: navigation (gli) and payload (pld), with commas or semicolons.

Native: degrees, magnetic heading with the declination beside it, depth in m, positions as NMEA
ddmm.mmm, ballast in cm3 (+ = lighter), pitch mass in mm forward, roll mass in degree (+ rolls to
starboard). A position is a GPS fix where the column DeadReckoning is 0, and in logs without it in
state 116 (at the surface, transmitting); and when it differs from the row before: the log repeats
the last one. Beam velocities of a payload's AD2CP
are not a velocity through the water without the transform and a reference layer: they are left out.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import (
    FLYING,
    from_degrees,
    heading_degrees,
    reference_declination,
)
from factory.importing.batteries import from_inside
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
from factory.importing.sample_clock import expect_going, parse_stamps, unix_seconds
from factory.importing.seawater import ctd_channels, pressure_of, siemens
from factory.importing.tally import OtherKind, Tally, leave_out, note_empty, note_unread
from factory.importing.units import in_unit
from twin.errors import InputError
from twin.records.coordinates import utc_minute

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


Array = NDArray[np.float64]
Columns = dict[str, Array]

MM = 1e-3
"""[m]"""
AT_SURFACE = 116
"""NavState of a glider at the surface that has its fixes."""
NO_VALUE = -999.0
"""Commands and sensors below this are switched off (-9999)."""
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
_CTD_NAMES = tuple(
    f"{prefix}_{part}"
    for prefix in _CTDS
    for part in ("TEMPERATURE", "SALINITY", "CONDUCTIVITY", "PRESSURE")
)
_NAVIGATION_LOG, _PAYLOAD_LOG = "navigation log", "payload log"
_CONDUCTIVITY = {"LEGATO": "mS/cm", "GPCTD": "S/m", "CTD": "mS/cm"}
"""Unit of each CTD's conductivity: RBR's in mS/cm, Sea-Bird's in S/m."""
_DEPLOYMENT = re.compile(r"(sea\d+)[._-]?m?(\d+)", re.IGNORECASE)


def read_seaexplorer(
    paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:
    """One log for each vehicle and mission among the files.

    Raises:
      WrongFormat: another kind of file.
      InputError: a payload log without its navigation log.
    """
    navigation: dict[str, list[Columns]] = {}
    payload: dict[str, list[Columns]] = {}
    files: dict[str, list[str]] = {}
    wanted = {
        _NAVIGATION_LOG: ("Timestamp", *_NAVIGATION),
        _PAYLOAD_LOG: ("PLD_REALTIMECLOCK", *_CTD_NAMES, *payload_names(options.payload)),
    }
    empty: dict[str, set[str]] = {what: set(names) for what, names in wanted.items()}
    for path, (what, table, columns) in each_file(paths, lambda p: _timed_table(p, tally), tally):
        name = deployment_of(path)
        logs = navigation if what == _NAVIGATION_LOG else payload
        logs.setdefault(name, []).append(columns)
        files.setdefault(name, []).append(path.name)
        tally.add("read", path.name, len(table), f"{what.split()[0]} rows")
        note_unread(what, [*table.columns, *table.texts], wanted[what], tally)
        empty[what] -= {n for n, v in table.columns.items() if np.isfinite(v).any()}
        empty[what] -= set(table.texts)
    for what, names in empty.items():
        note_empty(what, names, tally)
    alone = [name for name in payload if name not in navigation]
    for name in alone:
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
    """What a file is, its table, and its numbers with their time.

    Raises:
      WrongFormat: another kind of file.
      InputError: it cannot be read, or is empty, or without times.
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
    columns = _timed(table, clock, tally)
    expect_going(clock, columns["time"], table.columns, path.name)
    return what, table, columns


def deployment_of(path: Path) -> str:
    """Vehicle and mission by the file's name, such as SEA035_M12; else the name itself."""
    found = _DEPLOYMENT.match(path.name)
    return f"{found.group(1).upper()}_M{found.group(2)}" if found else path.name.split(".")[0]


def _timed(table: Table, name: str, tally: Tally) -> Columns:
    written = table.texts.get(name)
    time = parse_stamps(written) if written is not None else table.columns[name]
    if len(table) and not np.isfinite(time).any():
        raise InputError(f"{table.path.name}: column {name} holds no time (day/month/year h:m:s)")
    if len(table):
        time = unix_seconds(time, table.path.name, tally)
    return {"time": time, **table.columns}


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
    for column in columns:
        off = columns[column] <= NO_VALUE
        if column not in ("Lat", "Lon"):
            tally.add("removed", column, int(off.sum()), "switched off (-9999)")
            columns[column] = np.where(off, np.nan, columns[column])
    fixes, track = _positions(time, columns, tally)
    places = places_for(fixes, track)
    variation = _variation(time, columns, places, name, options.variation_deg, tally)
    depth = columns.get("Depth", np.full(len(time), np.nan))
    flying = bool(np.nanmax(depth, initial=0.0) > FLYING)
    channels: dict[str, Channel] = {}
    channels["measured_depth"] = clean("measured_depth", time, depth, tally, subject="Depth")
    if "Pitch" in columns:
        pitch = from_degrees(columns["Pitch"], "Pitch", tally, flying=flying)
        channels["measured_pitch"] = clean("measured_pitch", time, pitch, tally, subject="Pitch")
    for source, target, factor in _SIMPLE:
        if source in columns:
            values = factor * columns[source]
            channels[target] = clean(target, time, values, tally, subject=source)
    if "Pa" in columns:
        vacuum = from_inside(columns["Pa"])
        channels["measured_vacuum"] = clean("measured_vacuum", time, vacuum, tally, subject="Pa")
    for source, target in (("Heading", "measured_heading"), ("DesiredH", "commanded_heading")):
        if source in columns:
            if not len(variation):
                raise InputError(
                    f"{name}: {source} is magnetic and the log has no Declination and no position "
                    "from which it follows; give it with --variation-deg, east positive"
                )
            magnetic = heading_degrees(columns[source], source, tally)
            true = np.mod(magnetic + variation.at(time), 360.0)
            channels[target] = clean(target, time, true, tally, subject=source)
    if "NavState" in columns:
        floats = time[columns["NavState"] == AT_SURFACE]
        track = {**track, "afloat": Channel(floats, np.ones(len(floats)))}
    track = {**track, "awake": Channel(time, np.ones(len(time)))}
    channels |= _payload(payload, channels["measured_depth"], fixes, name, options, tally)
    return DeploymentLog(
        deployment=name,
        platform="SeaExplorer",
        channels={key: channel for key, channel in channels.items() if len(channel)},
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary=track,
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
    """[degree] east positive. Before its first fix a glider writes 0: the next value holds."""
    if variation_deg is not None:
        if "Declination" in columns:
            leave_out(["Declination"], "the user gives the variation", tally)
        return Channel(time[:1], np.array([variation_deg]))
    values = columns.get("Declination", np.full(len(time), np.nan))
    there = np.abs(values) <= 180.0
    wrong = int((np.isfinite(values) & ~there).sum())
    tally.add("removed", "Declination", wrong, "no declination: beyond 180 degree")
    if not (there & (values != 0.0)).any():
        found = reference_declination(places, name, tally)
        if len(found):
            return found
    unset = there & (values == 0.0)
    if unset.any() and (there & ~unset).any():
        tally.add("repaired", "Declination", int(unset.sum()), "not set yet (0): the nearest used")
        there &= ~unset
    return Channel(time[there], values[there])


def _positions(
    time: Array, columns: Columns, tally: Tally
) -> tuple[LoggedFixes, dict[str, Channel]]:
    """Fixes, and the on-board track where the vehicle reckons under water."""
    if not all(name in columns for name in ("Lat", "Lon", "NavState")):
        return NO_FIXES, {}
    raw_latitude, raw_longitude = columns["Lat"], columns["Lon"]
    none = (raw_latitude == 0.0) & (raw_longitude == 0.0)
    tally.add("removed", "Lat, Lon", int(none.sum()), "no position yet (0, 0)")
    decimal = np.nanmax(np.abs(raw_latitude), initial=0.0) <= 90.0 and (
        np.nanmax(np.abs(raw_longitude), initial=0.0) <= 180.0
    )
    if decimal:
        tally.add("repaired", "Lat, Lon", int((~none).sum()), "was in degrees, not ddmm.mmm")
        latitude, longitude = raw_latitude, raw_longitude
    else:
        latitude, longitude = degrees_minutes(raw_latitude), degrees_minutes(raw_longitude)
    good = ~none & np.isfinite(latitude) & np.isfinite(longitude)
    good &= (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0)
    moved = np.zeros(len(time), bool)
    moved[1:] = (np.diff(raw_latitude) != 0.0) | (np.diff(raw_longitude) != 0.0)
    surfaced = columns["NavState"] == AT_SURFACE
    reckons = columns.get("DeadReckoning", np.full(len(time), np.nan))
    told = np.isfinite(reckons)
    if (reckons == 0.0).any() and (reckons > 0.0).any():
        surfaced = np.where(told, reckons == 0.0, surfaced)
        # the first row of a log has none before it that it could repeat
        moved[:1] = told[:1] & (reckons[:1] == 0.0)
    else:  # a column that never changes is not kept
        surfaced = surfaced & ~(reckons > 0.0)
    fixed = good & surfaced & moved
    tally.add(
        "left out", "GPS fixes", int((good & surfaced & ~moved).sum()),
        "the last position again, no new fix",
    )  # fmt: skip
    fixes = LoggedFixes(time[fixed], latitude[fixed], longitude[fixed])
    reckoned = good & moved & ~surfaced
    if reckoned.sum() < 0.2 * len(time):
        return fixes, {}
    return fixes, {
        "latitude": Channel(time[good], latitude[good]),
        "longitude": Channel(time[good], longitude[good]),
    }


def _payload(
    pieces: Sequence[Columns],
    depth: Channel,
    fixes: LoggedFixes,
    name: str,
    options: ReadOptions,
    tally: Tally,
) -> dict[str, Channel]:
    """Temperature, salinity and density of the payload's CTD, and what else it carries."""
    if not pieces:
        return {}
    every = sorted({column for piece in pieces for column in piece if column != "time"})
    if any(column.startswith("AD2CP_V") for column in every):
        beams = sum(int(np.isfinite(p.get("AD2CP_V1_CN1", np.zeros(0))).sum()) for p in pieces)
        tally.add("left out", "AD2CP", beams, "beam velocities: no velocity through the water")
    wanted = (*_CTD_NAMES, *payload_names(options.payload))
    columns = stacked(pieces, ("time", *(n for n in every if n in wanted)))
    time, columns = tidy(columns.pop("time"), columns, f"{name} payload", tally)
    columns = with_values(columns)
    if len(depth):
        early, late = time < depth.time[0] - NEAR, time > depth.time[-1] + NEAR
        began, ended = utc_minute(float(depth.time[0])), utc_minute(float(depth.time[-1]))
        why = f"rows from before the navigation log begins at {began} UTC"
        tally.add("left out", f"{name} payload", int(early.sum()), why)
        why = f"{TRUNCATED}rows from after the navigation log ends at {ended} UTC"
        tally.add("left out", f"{name} payload", int(late.sum()), why)
    found = {n: Channel(time[np.isfinite(v)], v[np.isfinite(v)]) for n, v in columns.items()}
    channels = payload_channels(found, options.payload, tally)
    ctds = [c for c in _CTDS if len(found.get(f"{c}_TEMPERATURE", ()))]
    if not ctds:
        return channels
    ctd = ctds[0]
    others = [n for n in _CTD_NAMES if n in columns and not n.startswith(f"{ctd}_")]
    leave_out(others, f"the CTD is {ctd}", tally)
    latitude = float(np.median(fixes.latitude)) if len(fixes) else 0.0
    longitude = float(np.median(fixes.longitude)) if len(fixes) else 0.0
    pressure = columns.get(f"{ctd}_PRESSURE")
    if pressure is None:
        pressure = pressure_of(depth.known(time), latitude)
    practical, conductivity = columns.get(f"{ctd}_SALINITY"), columns.get(f"{ctd}_CONDUCTIVITY")
    if conductivity is not None:
        source = f"{ctd}_CONDUCTIVITY"
        conductivity = in_unit(conductivity, _CONDUCTIVITY[ctd], "S m-1", source)
        conductivity = siemens(conductivity, source, tally)
        if practical is not None:
            leave_out([source], f"{ctd}_SALINITY is there", tally)
    return channels | ctd_channels(
        time,
        temperature=columns[f"{ctd}_TEMPERATURE"],
        pressure=pressure,
        practical=practical,
        conductivity=conductivity,
        latitude=latitude,
        longitude=longitude,
        tally=tally,
    )
