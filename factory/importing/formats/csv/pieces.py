"""Pieces: what one table holds of each deployment, in the units and axes of a store."""

from __future__ import annotations

import dataclasses
import datetime
import re
from collections.abc import Mapping as Dict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import within_a_turn
from factory.importing.columns import MISSING, Table, column_names, read_table
from factory.importing.formats.csv.mapping import HEADINGS, ISO, Clock, Mapping, Signal
from factory.importing.formats.csv.velocity_checks import check_values
from factory.importing.sample_clock import expect_going, parse_stamps, unix_seconds
from factory.importing.tally import Tally, leave_out, note_unread
from factory.importing.units import SECONDS, in_unit
from twin.errors import InputError, unknown_name

Array = NDArray[np.float64]
KIND = "csv table"
"""What the report calls the tables."""


@dataclasses.dataclass(frozen=True)
class LogPiece:
    """The mapped columns of one deployment in one file, in the store's units and axes."""

    path: Path
    time: Array
    """[s] unix, as written: not sorted yet."""
    columns: Dict[str, Array]


def pieces_of(path: Path, mapping: Mapping, tally: Tally) -> list[tuple[str, LogPiece]]:
    """What one file holds, by deployment; every column is counted as what becomes of it."""
    table = read_table(path)
    present = [*table.columns, *table.texts]
    signals = mapping.signals_of(path)
    _account(path, present, mapping, signals, tally)
    time = _times(table, mapping.time, path, tally)
    columns = {
        name: values_of(table, name, signal, why, mapping, tally)
        for name, (signal, why) in signals.items()
        if signal.column in present
    }
    others = [n for n in present if "time" in n.lower() and n != mapping.time.column]
    hint = f": {', '.join(others)}?" if others else ""
    expect_going(
        mapping.time.column, time, columns, path.name,
        f"; name the column of the samples' own time in [time] of {mapping.name}{hint}",
    )  # fmt: skip
    if mapping.deployment == "name":
        return [(mapping.deployment_word, LogPiece(path, time, columns))]
    if mapping.deployment == "file":
        return [(path.name.split(".")[0], LogPiece(path, time, columns))]
    words = _words(table, mapping.deployment_word, path)
    return [
        (
            word,
            LogPiece(path, time[words == word], {n: v[words == word] for n, v in columns.items()}),
        )
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
                f"{mapping.name}, or write optional = true"
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
    if clock.written or clock.column in table.texts:
        if clock.column not in table.texts or not clock.written:
            raise InputError(
                f"{path.name}: time column {clock.column!r} holds "
                f"{'text' if clock.column in table.texts else 'numbers'}: write unit = "
                f'"{ISO if clock.column in table.texts else "s"}" in [time]'
            )
        time = _written(table.texts[clock.column], clock, path, tally)
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


def _written(words: NDArray[Any], clock: Clock, path: Path, tally: Tally) -> Array:
    """[s] unix time of written times; those that are not as the mapping says are counted.

    Raises:
      InputError: most are not.
    """
    time = parse_stamps(words, () if clock.unit == ISO else (clock.unit,))
    other = [str(word) for word in words[np.isnan(time)] if str(word).lower() not in MISSING]
    what = "ISO 8601 time" if clock.unit == ISO else f"time as {clock.unit!r}"
    if len(other) > 0.5 * len(words):
        one = other[len(other) // 2]
        raise InputError(
            f"{path.name}: time column {clock.column!r} holds {one!r:.40}, no {what}: "
            'write its layout as strptime has it, such as unit = "%m/%d/%Y %H:%M:%S" in [time]'
        )
    if other:
        tally.add("left out", clock.column, len(other), f"rows: {other[0]!r:.40} is no {what}")
    return time


def _whole(time: Array, path: Path, tally: Tally) -> Array:
    try:
        return unix_seconds(time, path.name, tally)
    except InputError as error:
        low, high = float(np.nanmin(time)), float(np.nanmax(time))
        raise InputError(
            f"{path.name}: time runs from {low:g} to {high:g} s, not unix time: give in [time] "
            "when the clock was 0, start = 2022-06-25T08:00:00Z or start_from_name = '^(\\d{8})_'"
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
            f"{path.name}: {found.group(1)!r}, which start_from_name finds, is not an ISO 8601 date"
        ) from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=datetime.UTC)
    return moment.timestamp()


def values_of(
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
    infinite = np.isinf(values)
    tally.add("removed", column, int(infinite.sum()), "infinite")
    values[missing | infinite] = np.nan
    values = in_unit(values, signal.unit, signal.wanted(name), f"{file} {column}")
    if name in HEADINGS:
        values = within_a_turn(values, column, tally)
        values = -values if signal.turns == "counterclockwise" else values
        return np.mod(values * signal.sign + (90.0 if signal.zero == "east" else 0.0), 360.0)
    values = values * signal.turn(name, mapping.frame)
    written = table.columns[column]
    check_values(name, values, written, signal.unit, signal.possible, f"{file} column {column!r}")
    return values
