"""Sensor tables: reads a Slocum's log from parquet or csv tables, recognised by their columns.

A flight table has pressure or depth and pitch; a GPS table positions; an event table names and
values; a truth table the speed by a DVL. Files are joined by the time and place they cover.
"""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import takewhile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import clean
from factory.importing.columns import Table, read_table, tidy, with_values
from factory.importing.deployment_log import (
    NO_FIXES,
    Channel,
    DeploymentLog,
    LoggedFixes,
    each_file,
    joined,
)
from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.formats.slocum.ascii_tables import is_text, read_text_table
from factory.importing.formats.slocum.native_sensors import (
    PLACE,
    WANTED,
    gps_fixes,
    native_variation,
    slocum_log,
)
from factory.importing.gps_fixes import RECEIVER, has_fix
from factory.importing.payload import payload_names
from factory.importing.sample_clock import parse_stamps, sample_clock, unix_seconds
from factory.importing.tally import Tally, note_empty, note_unread
from twin.errors import InputError
from twin.geodesy import offset

Array = NDArray[np.float64]

TIMES = ("time", "m_present_time", "sci_m_present_time", "timestamp", "Time")
LATITUDES, LONGITUDES = ("lat", "latitude", "m_gps_lat"), ("lon", "longitude", "m_gps_lon")
_ROLE_WORDS = re.compile(
    r"[_-](flight|gps|segments?|dvl|truth|events?|dr|ctd|science|sci|dbd|ebd|sbd|tbd)\b"
)
_READ: dict[str, tuple[str, ...]] = {
    "flight": WANTED,
    "science": WANTED,
    "gps": (*LATITUDES, *LONGITUDES, *WANTED, "status", "mag_var_rad", *RECEIVER),
    "truth": ("U_dvl_ms",),
    "events": ("name", "value"),
    "segments": ("t_start", "magvar_rad"),
}
"""Columns that are read, by kind of table."""
_FAR = 50e3
"""[m] Distance from the vehicle's own positions beyond which GPS fixes are another vehicle's."""


@dataclasses.dataclass
class DeploymentTables:
    """Tables of one deployment while they are collected."""

    name: str
    native: dict[str, list[Channel]] = dataclasses.field(default_factory=dict)
    fixes: list[LoggedFixes] = dataclasses.field(default_factory=list)
    variation: list[Channel] = dataclasses.field(default_factory=list)
    speed: list[Channel] = dataclasses.field(default_factory=list)
    files: list[str] = dataclasses.field(default_factory=list)

    def put(self, time: Array, columns: Mapping[str, Array], names: Iterable[str] = WANTED) -> None:
        """Add chunks of the named native sensors, as far as they have values."""
        for name in names:
            if name in columns and len(channel := Channel.finite(time, columns[name])):
                self.native.setdefault(name, []).append(channel)

    @property
    def span(self) -> tuple[float, float]:
        """[s] First and last time of the pressure, depth and pitch chunks."""
        pieces = [c for n in ("m_depth", "m_pressure", "m_pitch") for c in self.native.get(n, [])]
        return min(c.time[0] for c in pieces), max(c.time[-1] for c in pieces)


def role(table: Table) -> str | None:
    """Kind of a table: flight, truth, events, gps, segments, science; None if unknown."""
    names = set(table.columns) | set(table.texts)
    if "U_dvl_ms" in names:
        return "truth"
    if names & {"m_pressure", "m_depth", "m_water_pressure"}:
        return "flight"
    if {"name", "value"} <= names:
        return "events"
    if {"t_start", "t_end"} <= names:
        return "segments"
    if names & set(LATITUDES) and names & set(LONGITUDES):
        return "gps"
    return "science" if any(name.startswith("sci_") for name in names) else None


def _with_role(path: Path, tally: Tally) -> tuple[str, Table]:
    """Kind of a file's table, and the table.

    Raises:
      WrongFormat: the table is no Slocum's.
      InputError: the file cannot be read, or is empty.
    """
    table = read_text_table(path, tally) if is_text(path) else read_table(path)
    which = role(table)
    if which is None or (which == "gps" and "NavState" in table.columns):
        raise WrongFormat(path, [*table.columns, *table.texts])
    if not len(table):
        raise InputError(f"{path.name} holds column names and no rows")
    return which, table


def read_slocum_tables(
    paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:
    """Make a log of each deployment among the tables.

    Raises:
      WrongFormat: a file is of another kind.
      InputError: no file is a flight table, or a table belongs to no flight table.
    """
    tables: dict[str, list[Table]] = {}
    for _, (which, table) in each_file(paths, lambda path: _with_role(path, tally), tally):
        tables.setdefault(which, []).append(table)
    extra = payload_names(options.payload)
    for which, some in tables.items():
        names = [n for table in some for n in (*table.columns, *table.texts)]
        kind = f"{which} table"
        wanted = _READ.get(which, ()) + (extra if which in ("flight", "science") else ())
        note_unread(kind, names, (*TIMES, *wanted), tally)
        values = {n for table in some for n in with_values(table.columns)}
        note_empty(kind, [n for n in wanted if n not in values], tally)
    if "flight" not in tables:
        raise InputError(
            "none of the files is a flight table (m_depth or m_pressure, m_pitch, m_heading); "
            f"found only: {', '.join(sorted(tables))}"
        )
    groups: dict[str, DeploymentTables] = {}
    for table in tables["flight"]:
        time, columns = _timed(table, tally)
        tally.add("read", table.path.name, len(time), "flight rows")
        key = table.owner or _ROLE_WORDS.split(table.path.name.split(".")[0])[0]
        parts = groups.setdefault(key, DeploymentTables(key))
        parts.put(time, columns, (*WANTED, *extra))
        parts.files.append(table.path.name)
    for parts in groups.values():
        if not any(parts.native.get(n) for n in ("m_depth", "m_pressure", "m_pitch")):
            raise InputError(f"{parts.name}: the flight table holds no depth, pressure or pitch")
    for which in ("gps", "science", "truth", "events", "segments"):
        for table in tables.get(which, []):
            _attach(which, table, list(groups.values()), extra, tally)
    return [_log(parts, options, tally) for parts in groups.values()]


def _log(parts: DeploymentTables, options: ReadOptions, tally: Tally) -> DeploymentLog:
    variation = joined(parts.variation)
    if options.variation_deg is not None:
        variation = Channel(np.array([parts.span[0]]), np.array([options.variation_deg]))
    fixes = NO_FIXES
    if parts.fixes:
        every = [(one.time, one.latitude, one.longitude) for one in parts.fixes]
        fixes = LoggedFixes(*(np.concatenate(one) for one in zip(*every, strict=True))).once()
    return slocum_log(
        parts.name, {name: joined(pieces) for name, pieces in parts.native.items()}, fixes=fixes,
        variation=variation, truth_speed=joined(parts.speed), payload=options.payload,
        files=parts.files, tally=tally,
    )  # fmt: skip


def _timed(table: Table, tally: Tally, time_name: str | None = None) -> tuple[Array, dict]:
    subject = table.path.name
    valued = {*with_values(table.columns), *table.texts}
    there = [n for n in TIMES if n in valued] or [n for n in TIMES if n in table.columns]
    there = [time_name] if time_name else there
    if not there:
        some = ", ".join(list(table.columns)[:5])
        raise InputError(f"{subject} has no column of time ({', '.join(TIMES)}); it has {some}")
    measured = {n: v for n, v in table.columns.items() if n not in TIMES}
    clocks = {there[0]: _seconds(table, there[0], tally)}
    for one in there[1:]:
        with contextlib.suppress(InputError):  # numbers of no time: no clock
            clocks[one] = _seconds(table, one, Tally())
    name = sample_clock(clocks, measured, subject, tally)
    time = clocks[name]
    columns = {n: v for n, v in table.columns.items() if n != name}
    return tidy(time, columns, subject, tally)


def _seconds(table: Table, name: str, tally: Tally) -> Array:
    """[s] Unix times of a column of numbers or of texts."""
    words = table.texts.get(name)
    time = table.columns[name] if words is None else parse_stamps(words)
    return unix_seconds(time, table.path.name, tally)


def _attach(
    which: str,
    table: Table,
    groups: list[DeploymentTables],
    extra: Sequence[str],
    tally: Tally,
) -> None:
    """Add a table to the deployment that it belongs to."""
    subject = table.path.name
    if which == "events":
        _attach_events(table, groups, tally)
        return
    if which == "segments":
        tally.add("left out", subject, len(table), "derived segments; rows are cut from the log")
        if "magvar_rad" in table.columns:
            time, columns = _timed(table, tally, "t_start")
            parts = _owner(subject, time, groups)
            if not parts.variation:
                value = clean("variation", time, columns["magvar_rad"], tally)
                parts.variation.append(native_variation(value, tally))
        return
    time, columns = _timed(table, tally)
    parts = _owner(subject, time, groups)
    parts.files.append(subject)
    tally.add("read", subject, len(time), f"{which} rows")
    if which == "gps":
        valued = with_values(columns)
        latitude, longitude = (
            columns[next(n for n in (*(n for n in names if n in valued), *names) if n in columns)]
            for names in (LATITUDES, LONGITUDES)
        )
        status = valued.get("status", valued.get("m_gps_status", np.full(len(time), np.nan)))
        why = "the receiver says that it has none"
        latitude = tally.removed(latitude, ~has_fix(columns, len(time)), "GPS fixes", why)
        fixes = gps_fixes(time, latitude, longitude, status, tally=tally)
        parts.fixes.append(_same_place(subject, fixes, parts, tally))
        for name in [n for n in ("mag_var_rad", "m_gps_mag_var") if n in valued][:1]:
            native = Channel.finite(time, valued[name])
            parts.variation.append(native_variation(native, tally))
    elif which == "truth":
        speed = Channel.finite(time, _metres_per_second(columns["U_dvl_ms"], tally))
        parts.speed.append(speed)
        tally.add("read", "U_dvl_ms", len(speed), "finite truth samples")
    else:
        parts.put(time, columns, (*WANTED, *extra))


_CM_PER_M = 100.0
_FAST = 5.0
"""[m/s] Largest median speed of a glider; a larger one is in cm/s."""


def _metres_per_second(values: Array, tally: Tally) -> Array:
    """Speed of a DVL in m/s; cm/s and mm/s are recognised by size and converted, counted."""
    good = values[np.isfinite(values)]
    middle = float(np.median(good)) if good.size else 0.0
    for factor, unit in ((_CM_PER_M, "cm/s"), (_CM_PER_M * 10.0, "mm/s")):
        if _FAST < middle <= _FAST * factor / 5.0:
            tally.add("repaired", "U_dvl_ms", good.size, f"was in {unit} where m/s is native")
            return values / factor
    return values


def _attach_events(table: Table, groups: list[DeploymentTables], tally: Tally) -> None:
    """Add an event table, which holds rare sensors as rows of time, name and value."""
    subject = table.path.name
    names = table.texts.get("name")
    if names is None or "time" not in table.columns:
        raise InputError(f"{subject}: an event table needs the columns time, name, value")
    time = unix_seconds(table.columns["time"], subject, tally)
    parts = _owner(subject, time, groups)
    parts.files.append(subject)
    tally.add("read", subject, len(time), "events")
    for name in dict.fromkeys(str(n) for n in names):
        if name in WANTED:
            rows = names == name
            parts.put(*tidy(time[rows], {name: table.columns["value"][rows]}, subject, tally))


def _owner(subject: str, time: Array, groups: list[DeploymentTables]) -> DeploymentTables:
    """Deployment whose time the table shares; of several, the one with the nearest name."""
    good = time[np.isfinite(time)]
    shared = []
    for parts in groups:
        start, end = parts.span
        inside = (good >= start - _SLACK) & (good <= end + _SLACK)
        if inside.any():
            same = takewhile(lambda two: two[0] == two[1], zip(parts.name, subject, strict=False))
            alike = len(list(same))
            shared.append((alike, float(inside.mean()), parts))
    if not shared:
        raise InputError(
            f"{subject} covers another time than every flight table: it belongs to another "
            "vehicle or period; leave it out or add its flight table"
        )
    return max(shared, key=lambda item: item[:2])[2]


_SLACK = 3600.0
"""[s] Time by which a table may begin before and end after the flight rows."""


def _same_place(
    subject: str, fixes: LoggedFixes, parts: DeploymentTables, tally: Tally
) -> LoggedFixes:
    """Refuse fixes far from the vehicle's own positions; repair swapped coordinates."""
    own = [joined(parts.native.get(name, [])).values for name in PLACE]
    if not all(map(len, own)) or not len(fixes):
        return fixes
    middle = float(np.median(own[0])), float(np.median(own[1]))

    def away(latitude: Array, longitude: Array) -> float:
        return float(np.median(np.hypot(*offset(latitude, longitude, *middle))))

    latitude, longitude = (np.array([one.min(), one.max()]) for one in own)
    north, east = offset(latitude, longitude, *middle)
    reach = _FAR + float(np.hypot(np.ptp(north), np.ptp(east)))
    if away(fixes.latitude, fixes.longitude) <= reach:
        return fixes
    if away(fixes.longitude, fixes.latitude) <= reach:
        tally.add("repaired", subject, len(fixes), "latitude and longitude were swapped")
        return LoggedFixes(fixes.time, fixes.longitude, fixes.latitude)
    raise InputError(
        f"{subject}: its fixes are {away(fixes.latitude, fixes.longitude) / 1e3:.0f} km from the "
        f"vehicle's place in {parts.name}; they are another vehicle's"
    )
