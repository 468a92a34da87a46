"""Pieces: the mapped columns of one table for each deployment, in a store's units and axes."""

from __future__ import annotations

import datetime
import re
from collections.abc import Mapping as Dict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import within_a_turn
from factory.importing.columns import MISSING, Table, column_names, read_table
from factory.importing.deployment_log import Channel, DeploymentLog
from factory.importing.formats.csv.mapping import HEADINGS, ISO, Clock, Mapping, Signal
from factory.importing.sample_clock import expect_going, in_utc, parse_stamps, unix_seconds
from factory.importing.tally import Tally, leave_out, note_unread
from factory.importing.units import SECONDS, in_unit
from twin.errors import InputError, unknown_name
from twin.geodesy import offset
from twin.records.schema.limits import recorded_limits

Array = NDArray[np.float64]
KIND = "csv table"
"""Name of the tables in the report."""


class LogPiece(NamedTuple):
    """Mapped columns of one deployment in one file, in the store's units and axes."""

    path: Path
    time: Array
    """[s] Unix time, as written: not sorted yet."""
    columns: Dict[str, Array]


def pieces_of(path: Path, mapping: Mapping, tally: Tally) -> list[tuple[str, LogPiece]]:
    """Pieces of one file by deployment; each column is counted as read, left out or not mapped."""
    table = read_table(path, mapping.columns)
    tally.add("left out", path.name, table.short, "rows that were cut off")
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
    if mapping.deployment != "column":
        by_name = mapping.deployment == "name"
        word = mapping.deployment_word if by_name else path.name.split(".")[0]
        return [(word, LogPiece(path, time, columns))]
    found = []
    words = _words(table, mapping.deployment_word, path)
    for word in filter(None, dict.fromkeys(words.tolist())):
        mine = words == word
        own = {n: values[mine] for n, values in columns.items()}
        found.append((word, LogPiece(path, time[mine], own)))
    return found


def _words(table: Table, column: str, path: Path) -> NDArray[np.str_]:
    """Name of the deployment of each row."""
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
    """Refuse a file without a required column; count columns that are left out or not mapped."""
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
    reasons = {column: mapping.reason(column) for column in present if column not in used}
    ignored = {column: why for column, why in reasons.items() if why is not None}
    note_unread(KIND, present, used | set(ignored), tally)
    for column, why in ignored.items():
        leave_out((column,), f"files: {why}", tally)
    header = mapping.columns or column_names(path)
    for name in sorted({name for name in header if header.count(name) > 1}):
        if name in used:
            raise InputError(f"{path.name} has two columns {name!r}; rename one in the file")
        tally.add("left out", name, 1, "files: a second column of this name")


def _times(table: Table, clock: Clock, path: Path, tally: Tally) -> Array:
    """[s] Unix time of each row; NaN without a time."""
    present = [*table.columns, *table.texts]
    if clock.column not in present:
        raise InputError(f"{path.name}: time: {unknown_name('column', clock.column, present)}")
    words = table.texts.get(clock.column)
    if clock.written != (words is not None):
        raise InputError(
            f"{path.name}: time column {clock.column!r} holds "
            f"{'numbers' if words is None else 'text'}: write unit = "
            f'"{"s" if words is None else ISO}" in [time]'
        )
    if words is not None:
        time = _parse_times(words, clock, path, tally)
    else:
        time = table.columns[clock.column] * SECONDS[clock.unit]
        start = clock.start
        if clock.start_from_name is not None:
            start = _start_by_name(path, clock.start_from_name)
        time = _unix_times(time, path, tally) if start is None else time + start
    if not np.isfinite(time).any():
        raise InputError(f"{path.name}: no row has a time in column {clock.column!r}")
    tally.add("read", clock.column, np.isfinite(time), "as time")
    return time


def _parse_times(words: NDArray[Any], clock: Clock, path: Path, tally: Tally) -> Array:
    """[s] Unix time of written times; times of another layout than the mapping's are counted.

    Raises:
      InputError: most times have another layout.
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


def _unix_times(time: Array, path: Path, tally: Tally) -> Array:
    try:
        return unix_seconds(time, path.name, tally)
    except InputError as error:
        low, high = float(np.nanmin(time)), float(np.nanmax(time))
        raise InputError(
            f"{path.name}: time runs from {low:g} to {high:g} s, not unix time: give in [time] "
            "when the clock was 0, start = 2022-06-25T08:00:00Z or start_from_name = '^(\\d{8})_'"
        ) from error


_STAMP = 14
"""Digits of a date and a time in a file's name."""


def _start_by_name(path: Path, pattern: str) -> float:
    found = re.search(pattern, path.name)
    if found is None:
        raise InputError(
            f"{path.name}: its name does not fit start_from_name = {pattern!r} of the mapping"
        )
    word = found.group(1)
    if len(word) == _STAMP and word.isdecimal():  # ISO 8601 has a T between date and time
        word = f"{word[:8]}T{word[8:]}"
    try:
        return in_utc(datetime.datetime.fromisoformat(word))
    except ValueError:
        raise InputError(
            f"{path.name}: {found.group(1)!r}, which start_from_name finds, is not an ISO 8601 date"
        ) from None


def values_of(
    table: Table, name: str, signal: Signal, why: str, mapping: Mapping, tally: Tally
) -> Array:
    """Convert one column to the unit and axes of the store; sentinels become NaN, counted."""
    column, file = signal.column, table.path.name
    if column in table.texts:
        text = next((str(word) for word in table.texts[column] if str(word)), "")
        raise InputError(f"{file}: column {column!r} is to be {name} and holds text: {text!r}")
    written = table.columns[column]
    tally.add("read", column, np.isfinite(written), f"as {name}")
    if why:
        tally.add("note", name, np.isfinite(written), f"{file}: {why}")
    missing = np.isin(written, signal.sentinels)
    values = tally.removed(written, missing, column, "no measurement: a sentinel of the mapping")
    values = tally.removed(values, np.isinf(written), column, "infinite")
    values = in_unit(values, signal.unit, signal.wanted(name), f"{file} {column}")
    if name in HEADINGS:
        values = within_a_turn(values, column, tally)
        values = -values if signal.turns == "counterclockwise" else values
        return np.mod(values * signal.sign + (90.0 if signal.zero == "east" else 0.0), 360.0)
    values = values * signal.turn(name, mapping.frame)
    check_values(name, values, written, signal.unit, signal.possible, f"{file} column {column!r}")
    return values


FORWARD = ("measured_dvl_surge", "true_surge", "true_speed")
SIDEWAYS = ("measured_dvl_sway", "true_sway")
VELOCITIES = frozenset((*FORWARD, *SIDEWAYS, "measured_dvl_heave", "true_heave"))
_MOST = 0.3
"""Fraction of impossible values beyond which a column is no velocity."""
_ONE_VALUE = 0.1
"""Fraction of the samples beyond which a single value, of either sign, is a sentinel."""
_FEWEST = 100
"""Minimum number of values that show a fault in a column that never changes."""
_WINDOW = 10.0
"""[s] Averaging time to compare track and velocity: a GPS's metre is then 0.1 m/s."""
_HOLE = 5.0
"""[s] Longest gap of the velocity in a window that is used."""
_MOVING = 0.3
"""[m/s] Smallest speed that is compared; below it the track's noise dominates."""
_WINDOWS = 5
"""Minimum number of windows in a comparison."""
SCALE = (0.4, 2.5)
"""Range of track speed / velocity, for a current of half the vehicle's speed, and noise."""
_CURRENT = 1.5
"""[m/s] Largest difference that a current may cause: stronger ones are rare where vehicles go."""
_AGREES = 0.5
"""Smallest size of the correlation from which the sign of sway is judged."""


def check_values(
    name: str,
    values: Array,
    written: Array,
    unit: str,
    possible: tuple[float, float] | None,
    subject: str,
) -> None:
    """Refuse a column of velocities if most are impossible for a vehicle.

    Args:
      values: [m/s] without the mapping's sentinels.
      written: the samples as the file has them, in `unit`.
      possible: [m/s] lowest and highest by the mapping, which removes a sentinel beyond them; None:
        those of the schema.

    Raises:
      InputError: the column is a distance, or has a sentinel that the mapping does not name.
    """
    there = np.isfinite(values)
    good, written = values[there], written[there]
    if name not in VELOCITIES or not good.size:
        return
    low, high = possible or recorded_limits(name)
    wild = (good < low) | (good > high)
    found, counts = np.unique(np.abs(written[wild]), return_counts=True)
    repeats = wild & np.isin(np.abs(written), found[counts > _ONE_VALUE * good.size])
    if possible is not None:
        wild, good = wild[~repeats], good[~repeats]
    if not good.size or wild.mean() <= _MOST:
        return
    if possible is None and repeats.any():
        found, counts = np.unique(written[repeats], return_counts=True)
        words = [repr(value).removesuffix(".0") for value in found.tolist()]
        shares = " and ".join(
            f"{word} {unit} in {100.0 * count / good.size:.0f} %"
            for word, count in zip(words, counts, strict=True)
        )
        raise InputError(
            f"{subject} is to be {name} and is {shares} of its samples: a sentinel? Name it as the "
            f"file has it, sentinels = [{', '.join(words)}], or give what is possible, in m/s, "
            "possible = [LOW, HIGH]"
        )
    raise InputError(
        f"{subject} is to be {name} and is beyond {low:g} to {high:g} m/s in "
        f"{100.0 * wild.mean():.0f} % of its samples (median size {np.median(np.abs(good)):.4g}), "
        "no two alike: a distance, not a velocity. Leave the file out, or the column: [ignored]"
    )


def check_track(log: DeploymentLog, tally: Tally) -> None:
    """Compare the velocities of a log with its track, if it has a track and a heading.

    A forward velocity that never changes is reported as suspect, and so is a sway of the opposite
    sign to the track's.

    Raises:
      InputError: the track moves many times faster or slower than the forward velocity.
    """

    def doubt(name: str, why: str) -> None:
        tally.doubt(name, f"{log.deployment}: {why}", len(log.channel(name)))

    for name in (*FORWARD, *SIDEWAYS):
        channel = log.channel(name)
        if len(channel) >= _FEWEST and np.ptp(channel.values) == 0.0:
            doubt(name, f"{channel.values[0]:g} in every sample; was the sensor off?")
    ahead = next((n for n in FORWARD if len(log.channel(n)) > 1), None)
    heading = log.channel("measured_heading")
    if ahead is None or not len(heading):
        return
    times, north, east = _track(log)
    if not len(times):
        return
    middle = 0.5 * (times[1:] + times[:-1])
    angle = np.interp(middle, heading.time, np.unwrap(np.radians(heading.values)))
    v_north, v_east = np.diff(north) / np.diff(times), np.diff(east) / np.diff(times)
    forward = v_north * np.cos(angle) + v_east * np.sin(angle)
    starboard = -v_north * np.sin(angle) + v_east * np.cos(angle)
    said = _means(log.channel(ahead), times)
    use = np.isfinite(said) & (np.hypot(v_north, v_east) > _MOVING)
    if use.sum() < _WINDOWS:
        return
    contradiction = _scale(log, ahead, said[use], forward[use])
    if contradiction:
        doubt(ahead, contradiction)
    for name in SIDEWAYS:
        aside = _means(log.channel(name), times)
        both = np.isfinite(aside) & use
        if both.sum() < _WINDOWS or np.ptp(aside[both]) == 0.0 or np.ptp(starboard[both]) == 0.0:
            continue
        agrees = float(np.corrcoef(aside[both], starboard[both])[0, 1])
        if agrees < -_AGREES:
            why = f"the track moves to the other side (correlation {agrees:.2f})"
            doubt(name, f"{why}: wrong sign or frame")


def _scale(log: DeploymentLog, name: str, said: Array, track: Array) -> str:
    """Text on a difference between forward velocity and track that a current explains, or "".

    Raises:
      InputError: no current explains the difference.
    """
    size = float(np.median(np.abs(said)))
    moved = float(np.median(np.abs(track)))
    low, high = SCALE
    if (size > 0.0 and low <= moved / size <= high) or max(size, moved) < _MOVING:
        return ""
    channel = log.channel(name)
    found = f"{size:.3g} m/s where the track moves forward at {moved:.3g} m/s (medians)"
    if size > 0.0 and low <= moved * channel.spacing / size <= high:
        what = f"metres per sample of {channel.spacing:g} s?"
    elif np.ptp(channel.values) == 0.0:
        what = "a sensor that was off?"
    elif abs(moved - size) > _CURRENT:
        what = "a distance, or another unit?"
    else:  # a current can cause this difference
        return found
    raise InputError(
        f"{', '.join(log.files)}: {name} has {found}, not a velocity in m/s: {what} Correct the "
        "unit, or leave the file or the column out"
    )


def _track(log: DeploymentLog) -> tuple[Array, Array, Array]:
    """Edges [s] of the windows with samples of the track, and north and east [m] at these times;
    empty without a track."""
    latitude, longitude = log.channel("latitude"), log.channel("longitude")
    if len(latitude) < 2 or len(longitude) < 2:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    windows = np.unique((latitude.time - latitude.time[0]) // _WINDOW)
    times = latitude.time[0] + _WINDOW * np.union1d(windows, windows + 1.0)
    times = times[times < latitude.time[-1]]
    north, east = offset(
        latitude.at(times), longitude.at(times),
        float(latitude.values[0]), float(longitude.values[0]),
    )  # fmt: skip
    return times, north, east


def _means(channel: Channel, times: Array) -> Array:
    """Mean of a channel between each two times; NaN where the channel has a gap."""
    found = np.full(max(len(times) - 1, 0), np.nan)
    for k in range(len(found)):
        inside = channel.within(times[k], times[k + 1])
        steps = np.diff([times[k], *inside.time, times[k + 1]])
        if len(inside) and steps.max() <= _HOLE:
            found[k] = float(inside.values.mean())
    return found
