"""Reader of tables by a mapping: columns into signals of the schema, each column accounted for."""

from __future__ import annotations

import dataclasses
import datetime
import re
from collections.abc import Mapping as Dict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing.formats.base import SHORTEST, TABLES, ReadOptions
from factory.importing.formats.csv.mapping import (
    HEADINGS,
    ISO,
    LOCKS,
    LOG_ONLY,
    Clock,
    Mapping,
    Signal,
    load_mapping,
    shipped_names,
)
from factory.importing.formats.csv.row_times import row_times
from factory.importing.formats.csv.velocity_checks import check_track, check_values
from factory.importing.formats.registry import likely_kind
from factory.importing.reading.columns import (
    Table,
    column_names,
    parse_stamps,
    read_table,
    stacked,
    tidy,
    unix_seconds,
)
from factory.importing.reading.deployment_log import EMPTY, NO_FIXES, Channel, DeploymentLog, Fixes
from factory.importing.reading.tally import Tally
from factory.importing.reading.units import SECONDS, in_unit
from factory.importing.reading.unread_names import leave_out, note_empty, note_unread
from factory.importing.repairs.cleaning import LIMITS, clean
from factory.importing.repairs.seawater import ctd_channels, pressure_of
from twin.errors import InputError, unknown_name
from twin.records.limits import recorded_limits

Array = NDArray[np.float64]
KIND = "csv table"
"""What the report calls the tables."""


@dataclasses.dataclass(frozen=True)
class Piece:
    """The mapped columns of one deployment in one file, in the store's units and axes."""

    path: Path
    time: Array
    """[s] unix, as written: not sorted yet."""
    columns: Dict[str, Array]


def read_tables(
    paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:  # fmt: skip
    """One log for each deployment that the mapping tells apart.

    Raises:
      InputError: no mapping, or one that does not fit the files; a velocity that is none.
    """
    if options.mapping is None:
        kind = likely_kind(column_names(paths[0])) if paths[0].suffix.lower() in TABLES else None
        hint = f". It looks like {kind}: use `factory import {kind}`" if kind else ""
        raise InputError(
            f"{paths[0].name}: csv tables need a --mapping, a TOML file that says which column is "
            "which signal (docs/real.md shows one), or a shipped one "
            f"({', '.join(shipped_names())}){hint}"
        )
    mapping = load_mapping(options.mapping)
    groups: dict[str, list[Piece]] = {}
    for path in paths:
        for deployment, piece in _pieces(path, mapping, tally):
            groups.setdefault(deployment, []).append(piece)
    every = [piece.columns for pieces in groups.values() for piece in pieces]
    valued = {n for columns in every for n, values in columns.items() if np.isfinite(values).any()}
    note_empty(KIND, (s.column for n, s in mapping.signals.items() if n not in valued), tally)
    return [
        _log(name, pieces, mapping, options.variation_deg, tally)
        for name, pieces in groups.items()
    ]  # fmt: skip


def _pieces(path: Path, mapping: Mapping, tally: Tally) -> list[tuple[str, Piece]]:
    """What one file holds, by deployment; every column is counted as what becomes of it."""
    table = read_table(path)
    present = [*table.columns, *table.texts]
    signals = mapping.signals_of(path)
    _account(path, present, mapping, signals, tally)
    time = _times(table, mapping.time, path, tally)
    columns = {
        name: _values(table, name, signal, why, mapping, tally)
        for name, (signal, why) in signals.items()
        if signal.column in present
    }
    if mapping.deployment == "name":
        return [(mapping.deployment_word, Piece(path, time, columns))]
    if mapping.deployment == "file":
        return [(path.name.split(".")[0], Piece(path, time, columns))]
    words = _words(table, mapping.deployment_word, path)
    return [
        (word, Piece(path, time[words == word], {n: v[words == word] for n, v in columns.items()}))
        for word in dict.fromkeys(words.tolist())
        if word
    ]


def _words(table: Table, column: str, path: Path) -> NDArray[np.str_]:
    """The name of the deployment of each row."""
    if column in table.texts:
        return np.array([str(word) for word in table.texts[column]])
    if column in table.columns:
        return np.array(["" if np.isnan(v) else f"{v:g}" for v in table.columns[column]])
    raise InputError(
        f"{path.name}: {unknown_name('column', column, [*table.columns, *table.texts])}; the "
        "mapping's deployment names it"
    )


def _account(
    path: Path,
    present: Sequence[str],
    mapping: Mapping,
    signals: Dict[str, tuple[Signal, str]],
    tally: Tally,
) -> None:
    """Refuse a column that must be there; count those that are left out or not mapped."""
    for name, (signal, _) in signals.items():
        if signal.column in present:
            continue
        if not signal.optional:
            raise InputError(
                f"{path.name}: {name}: {unknown_name('column', signal.column, present)}; correct "
                f"{mapping.name}, or say optional = true"
            )
        tally.add("missing", name, 1, f"column {signal.column}, which the mapping calls optional")
    used = {signal.column for signal, _ in signals.values()} | {mapping.time.column}
    if mapping.deployment == "column":
        used.add(mapping.deployment_word)
    reasons = {c: mapping.reason(c) for c in present if c not in used}
    ignored = {column: why for column, why in reasons.items() if why is not None}
    note_unread(KIND, present, used | set(ignored), tally)
    for column, why in ignored.items():
        leave_out((column,), f"files: {why}", tally)
    header = column_names(path)
    twice = sorted({name for name in header if header.count(name) > 1})
    if set(twice) & used:
        raise InputError(f"{path.name} has two columns {twice[0]!r}; rename one in the file")
    for name in twice:
        tally.add("left out", name, 1, "files: a second column of this name")


def _times(table: Table, clock: Clock, path: Path, tally: Tally) -> Array:
    """[s] unix time of each row; NaN where there is none."""
    present = [*table.columns, *table.texts]
    if clock.column not in present:
        raise InputError(f"{path.name}: time: {unknown_name('column', clock.column, present)}")
    if clock.unit == ISO or clock.column in table.texts:
        if clock.column not in table.texts or clock.unit != ISO:
            raise InputError(
                f"{path.name}: time column {clock.column!r} holds "
                f"{'text' if clock.column in table.texts else 'numbers'}: say unit = "
                f'"{ISO if clock.column in table.texts else "s"}" in [time]'
            )
        time = parse_stamps(table.texts[clock.column])
    else:
        time = table.columns[clock.column] * SECONDS[clock.unit]
        start = clock.start
        if clock.start_from_name is not None:
            start = _start_by_name(path, clock.start_from_name)
        if start is not None:
            time = time + start
        else:
            time = _whole(time, path, tally)
    if not np.isfinite(time).any():
        raise InputError(f"{path.name}: no row has a time in column {clock.column!r}")
    tally.add("read", clock.column, int(np.isfinite(time).sum()), "as time")
    return time


def _whole(time: Array, path: Path, tally: Tally) -> Array:
    try:
        return unix_seconds(time, path.name, tally)
    except InputError as error:
        low, high = float(np.nanmin(time)), float(np.nanmax(time))
        raise InputError(
            f"{path.name}: time runs from {low:g} to {high:g} s, no unix time: say in [time] when "
            "the clock was 0, start = 2022-06-25T08:00:00Z or start_from_name = '^(\\d{8})_'"
        ) from error


def _start_by_name(path: Path, pattern: str) -> float:
    found = re.search(pattern, path.name)
    if found is None:
        raise InputError(
            f"{path.name}: its name does not fit start_from_name = {pattern!r} of the mapping"
        )
    try:
        moment = datetime.datetime.fromisoformat(found.group(1))
    except ValueError:
        raise InputError(
            f"{path.name}: {found.group(1)!r}, which start_from_name finds, is no ISO 8601 date"
        ) from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=datetime.UTC)
    return moment.timestamp()


def _values(
    table: Table, name: str, signal: Signal, why: str, mapping: Mapping, tally: Tally
) -> Array:
    """One column in the unit and axes of the store; sentinels are NaN, counted."""
    column, file = signal.column, table.path.name
    if column in table.texts:
        text = next((str(word) for word in table.texts[column] if str(word)), "")
        raise InputError(f"{file}: column {column!r} is to be {name} and holds text: {text!r}")
    values = table.columns[column].copy()
    tally.add("read", column, int(np.isfinite(values).sum()), f"as {name}")
    if why:
        tally.add("note", name, int(np.isfinite(values).sum()), f"{file}: {why}")
    missing = np.isin(values, signal.sentinels)
    tally.add("removed", column, int(missing.sum()), "no measurement: a sentinel of the mapping")
    values[missing] = np.nan
    values = in_unit(values, signal.unit, signal.wanted(name), f"{file} {column}")
    if name in HEADINGS:
        values = -values if signal.turns == "counterclockwise" else values
        return np.mod(values * signal.sign + (90.0 if signal.zero == "east" else 0.0), 360.0)
    values = values * signal.turn(name, mapping.frame)
    written = table.columns[column]
    check_values(name, values, written, signal.unit, signal.possible, f"{file} column {column!r}")
    return values


def _log(
    deployment: str,
    pieces: Sequence[Piece],
    mapping: Mapping,
    variation_deg: float | None,
    tally: Tally,
) -> DeploymentLog:
    """The pieces of one deployment as one log."""
    names = [name for name in mapping.signals if any(name in p.columns for p in pieces)]
    together = stacked([{"time": p.time, **p.columns} for p in pieces], ["time", *names])
    time, columns = tidy(together.pop("time"), together, deployment, tally)
    channels: dict[str, Channel] = {}
    for name, values in columns.items():
        signal = mapping.signals[name]
        channel = _clean(name, signal, time, values, tally)
        if len(channel):
            channels[name] = channel
        elif np.isfinite(values).any() or not signal.optional:
            tally.add("missing", name, 1, f"{deployment} has no value of it")
    if mapping.dvl_lock is not None and "measured_dvl_surge" in channels:
        has = np.isin(time, channels["measured_dvl_surge"].time).astype(np.float64)
        channels["measured_dvl_mode"] = Channel(time, LOCKS[mapping.dvl_lock] * has)
        tally.add(
            "note", "measured_dvl_mode", int(has.sum()), f"{mapping.dvl_lock}, says the mapping"
        )
    variation = channels.pop("magnetic_variation", EMPTY)
    _to_true_north(deployment, channels, mapping, variation, variation_deg, tally)
    fixes = _fixes(channels.pop("gps_latitude", EMPTY), channels.pop("gps_longitude", EMPTY), tally)
    log = DeploymentLog(
        deployment=deployment,
        platform=mapping.vehicle,
        channels={n: c for n, c in channels.items() if n not in LOG_ONLY},
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary={n: c for n, c in channels.items() if n in LOG_ONLY and n != "conductivity"},
        files=tuple(piece.path.name for piece in pieces),
        pieces=row_times(mapping, time, [piece.time for piece in pieces]),
        period=mapping.period_s or _spacing(time),
        held=frozenset(n for n, s in mapping.signals.items() if s.held or _commands(n)),
        model=mapping.model,
    )
    log = _with_water(log, channels.get("conductivity"), tally)
    check_track(log, tally)
    return log


def _commands(name: str) -> bool:
    return name.startswith("commanded_")


def _spacing(time: Array) -> float | None:
    """[s] Usual time between rows, to three digits; None for a single row."""
    if len(time) < 2:
        return None
    return max(float(f"{np.median(np.diff(time)):.3g}"), SHORTEST)


def _clean(name: str, signal: Signal, time: Array, values: Array, tally: Tally) -> Channel:
    """The possible values of a signal; what the mapping and the schema exclude is counted."""
    low, high = signal.possible or (-np.inf, np.inf)
    if name not in LOG_ONLY and name not in LIMITS:
        least, most = recorded_limits(name)
        low, high = max(low, least), min(high, most)
    with np.errstate(invalid="ignore"):
        bad = np.isfinite(values) & ~((values >= low) & (values <= high))
    tally.add("removed", name, int(bad.sum()), f"outside {low:g} to {high:g}")
    return clean(name, time, np.where(bad, np.nan, values), tally)


def _to_true_north(
    deployment: str,
    channels: dict[str, Channel],
    mapping: Mapping,
    variation: Channel,
    variation_deg: float | None,
    tally: Tally,
) -> None:
    """Turn magnetic headings to true ones, in place."""
    for name in HEADINGS & set(channels):
        if mapping.signals[name].north == "true":
            continue
        heading = channels[name]
        if variation_deg is None and not len(variation):
            raise InputError(
                f"{deployment}: {name} is from magnetic north and the log has no variation: give "
                "--variation-deg, or map magnetic_variation"
            )
        turn = variation.at(heading.time) if variation_deg is None else variation_deg
        channels[name] = Channel(heading.time, np.mod(heading.values + turn, 360.0))
        tally.add("note", name, len(heading), "turned from magnetic to true north")


def _fixes(latitude: Channel, longitude: Channel, tally: Tally) -> Fixes:
    """GPS fixes: a position that a log repeats in every row is one fix, and at its beginning an
    old one."""
    both = np.intersect1d(latitude.time, longitude.time)
    if not both.size:
        return NO_FIXES
    north = latitude.values[np.isin(latitude.time, both)]
    east = longitude.values[np.isin(longitude.time, both)]
    fresh = np.ones(len(both), bool)
    fresh[1:] = (np.diff(north) != 0.0) | (np.diff(east) != 0.0)
    if len(both) > 1:
        fresh[0] = fresh[1]
    tally.add("left out", "GPS fixes", int((~fresh).sum()), "rows that repeat the position before")
    return Fixes(both, north, east).keep(fresh)


def _with_water(log: DeploymentLog, conductivity: Channel | None, tally: Tally) -> DeploymentLog:
    """Salinity and density where the CTD, a pressure and a place allow it."""
    warm, fresh = log.channel("measured_temperature"), log.channel("measured_salinity")
    pressure, depth = log.channel("measured_pressure"), log.channel("measured_depth")
    have_salt = len(fresh) or conductivity is not None
    if not len(warm) or not have_salt or not (len(pressure) or len(depth)):
        return log
    track = log.channel("latitude"), log.channel("longitude")
    places = (log.fixes.latitude, log.fixes.longitude) if len(log.fixes) else (
        track[0].values, track[1].values
    )  # fmt: skip
    latitude, longitude = (float(np.median(p)) if len(p) else 0.0 for p in places)
    dbar = pressure if len(pressure) else Channel(depth.time, pressure_of(depth.values, latitude))
    both = warm.time
    made = ctd_channels(
        both,
        temperature=warm.values,
        pressure=dbar.at(both),
        practical=fresh.at(both) if len(fresh) else None,
        conductivity=None if len(fresh) or conductivity is None else conductivity.at(both),
        latitude=latitude,
        longitude=longitude,
        tally=tally,
    )
    return dataclasses.replace(log, channels={**log.channels, **made})
