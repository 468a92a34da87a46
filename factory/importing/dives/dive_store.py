"""Dive store: the dives of all logs on one time grid as a dataset, and the import report.

Pieces are rows of a log that is not cut into dives, such as the runs of a propelled vehicle.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import UNREADABLE, Channel, DeploymentLog, naming
from factory.importing.dives.dive_checks import (
    complete,
    doubts_of,
    keep_possible,
    since_clock,
    standing,
    tell_above_sea,
    tell_silent,
)
from factory.importing.dives.dive_rows import FRAMES, DiveRow, rows_dataset
from factory.importing.dives.positions import averaged_current, frame_origin, row_positions
from factory.importing.dives.regular_times import cells_on_grid, not_empty, on_grid
from factory.importing.dives.segments import LogSegment, cut, pieces
from factory.importing.gps_fixes import tell_read
from factory.importing.plausibility import DiveRules, check_signs
from factory.importing.pressures import with_depth, zeroed
from factory.importing.tally import (
    ImportReport,
    Tally,
    likely_replacements,
    summarise,
    tell_unread,
    unread,
)
from twin.errors import InputError
from twin.records.attributes import (
    COMMENT,
    FILES,
    IMPORT_REPORT,
    PLATFORM,
    SOURCE_FORMAT,
    VEHICLE_MJCF,
)
from twin.records.schema import VARIABLES
from twin.vehicle.vehicle import load_vehicle

if TYPE_CHECKING:
    import xarray as xr


WANTED = (
    "measured_pitch", "measured_roll", "measured_heading", "measured_pump", "measured_shift",
    "measured_rotation", "measured_density",
)  # fmt: skip
"""Channels whose absence the report lists."""


def build(
    logs: Sequence[DeploymentLog],
    *,
    kind: str,
    period: float,
    rules: DiveRules,
    tally: Tally,
    files: Sequence[str],
    held: frozenset[str] = frozenset(),
    lacks: frozenset[str] = frozenset(),
) -> tuple[xr.Dataset, ImportReport]:
    """Build one dataset of all logs, with the rows of each deployment in time order.

    Args:
      logs: logs of one kind of vehicle.
      kind: the importer's name.
      period: [s] sampling interval of the store.
      rules: limits by which the logs are cut into dives.
      tally: receives the counts; those of the reader are in it.
      files: names of the files, for the report.
      held: channels whose last value holds between samples.
      lacks: channels that no such vehicle has: their absence is not reported.

    Raises:
      InputError: no log holds a dive, or none can be cut into dives.
    """
    for log in logs:
        if not log.channels:
            tally.add("left out", log.deployment, 1, "no signal has a value")
    logs = [log for log in logs if log.channels]
    names = summarise(files)
    if not logs:
        raise InputError(f"{names}: no signal has a value")
    tell_read(logs, tally)
    rows: list[DiveRow] = []
    lacking: dict[str, list[str]] = {}
    failed: list[InputError] = []
    deepest = 0
    for log in sorted(logs, key=lambda one: (one.span[0], one.deployment)):
        try:
            found, samples = rows_of(log, period=period, rules=rules, tally=tally, held=held)
        except InputError as error:
            failed.append(error)
            tally.add("left out", UNREADABLE, len(log.files), str(error))
            continue
        rows += found
        deepest = max(deepest, samples)
        absent = [n for n in WANTED if not len(log.channel(n)) and n not in lacks]
        for name in absent if len(log.fixes) else ["GPS fixes", *absent]:
            lacking.setdefault(name, []).append(log.deployment)
    by_depth = any(log.pieces is None for log in logs)
    _tell_lacking(lacking, tally, by_depth)
    if not rows and failed:
        raise failed[0]
    if not rows and not by_depth:
        raise InputError(
            f"no row of {rules.min_duration:g} s or longer in {names}; rows end at holes"
            " in the times that are longer than the mapping's gap_s"
        )
    if not rows and deepest < 2:
        raise InputError(f"{names}: the log holds 1 sample; a dive needs many")
    if not rows:
        raise InputError(
            f"no dive deeper than {rules.min_depth:g} m and longer than {rules.min_duration:g} s "
            f"in {names}; lower --min-depth for a shallower log"
        )
    with_rows = {row.deployment for row in rows}
    used = [log for log in logs if log.deployment in with_rows]
    models = {log.model for log in used if log.model is not None}
    report = _report(rows, kind, period, files, tally)
    attributes = {
        SOURCE_FORMAT: kind,
        PLATFORM: ", ".join(dict.fromkeys(row.platform for row in rows)),
        FILES: " ".join(files),
        IMPORT_REPORT: json.dumps(report.to_dict()),
    }
    if len(models) == 1:  # one vehicle file models the whole store
        attributes[VEHICLE_MJCF] = load_vehicle(next(iter(models))).xml
    if any(log.simulated for log in used):
        attributes[COMMENT] = f"The files say that they are simulated. {FRAMES}"
    return rows_dataset(rows, period, attributes), report


def _tell_lacking(lacking: Mapping[str, Sequence[str]], tally: Tally, by_depth: bool) -> None:
    """Report names in the files that are not read, and missing channels or fixes.

    Args:
      lacking: names of deployments, by the channel (or GPS fixes) that they lack.
      by_depth: whether rows without fixes are split by depth.
    """
    tell_unread(tally)
    instead = likely_replacements(tuple(lacking), unread(tally))
    for name, several in lacking.items():
        deployments = list(dict.fromkeys(several))
        split = " (rows are split by depth)" if name == "GPS fixes" and by_depth else ""
        other = f"; is it {instead[name]!r}, which is not read?" if name in instead else ""
        why = f"in {summarise(deployments, 3)}{split}{other}"
        tally.add("missing", name, len(deployments), why)


def rows_of(
    log: DeploymentLog,
    *,
    period: float,
    rules: DiveRules,
    tally: Tally,
    held: frozenset[str] = frozenset(),
) -> tuple[list[DiveRow], int]:
    """Rows of one log in time order, and the number of its depth samples.

    Raises:
      InputError: the log has neither pressure nor depth.
    """
    with naming(log):
        log, segments = _segmented(log, rules, tally)
        log = dataclasses.replace(log, held=held | log.held)
        segments = not_empty(log, segments, period, tally)
        nexts = [*(segment.start for segment in segments[1:]), float("inf")]
        rows = [
            _row_of(log, segment, after, period, rules, tally)
            for segment, after in zip(segments, nexts, strict=False)
        ]
    return rows, len(log.channel("measured_depth"))


def _segmented(
    log: DeploymentLog, rules: DiveRules, tally: Tally
) -> tuple[DeploymentLog, list[LogSegment]]:
    """Correct a log's depths to the surface; cut the log into dives or rows in time order.

    Raises:
      InputError: the log has neither pressure nor depth.
    """
    before = len(tally.doubts)
    log = zeroed(since_clock(with_depth(log, tally), rules, tally), rules, tally)
    depth = log.channel("measured_depth")
    tell_above_sea(log, tally)
    check_signs(log, tally)
    if not len(log.channel("measured_pitch")):
        why = f"{log.deployment} has none: identification and dead reckoning need it"
        tally.add("note", "measured_pitch", 1, why)
    if log.pieces is None:
        segments = cut(log, depth, rules, tally)
        why = f"no dive: deepest {depth.values.max():.3g} m"
    else:
        segments, why = pieces(log, rules, tally), "no row is long enough"
    if not segments:
        tally.add("left out", log.deployment, 1, why)
    outside, shallow = _outside(depth, segments), depth.values <= rules.surface_depth
    where = f"at the surface between dives (above {rules.surface_depth:g} m)"
    tally.add("left out", "depth samples", outside & shallow, where)
    where = "under water, but no dive: too shallow or too short"
    tally.add("left out", "depth samples", outside & ~shallow, where)
    for name in ("true_speed", "velocity_north"):
        outside = _outside(log.channel(name), segments)
        tally.add("left out", name, outside, "truth samples outside rows")
    return dataclasses.replace(log, doubts=(*log.doubts, *tally.doubts[before:])), segments


def _row_of(
    log: DeploymentLog,
    segment: LogSegment,
    after: float,
    period: float,
    rules: DiveRules,
    tally: Tally,
) -> DiveRow:
    """Make the row of one segment of a log that `_segmented` returned.

    Args:
      after: [s] start of the next row.
    """
    signals = on_grid(log, segment, period, rules, tally)
    numbers = _numbers(log, segment, after)
    whole = complete(log, segment, tally)
    tell_silent(log, segment, tally)
    driven = numbers.get("thruster_fraction", 0.0)
    numbers["dac_north"], numbers["dac_east"] = averaged_current(
        signals, segment, period,
        # a propelled vehicle's depth rate does not give its speed
        complete=whole and log.pieces is None, driven=driven,
    )  # fmt: skip
    standing(log, segment, tally)
    found = keep_possible(signals) + doubts_of(log, segment, signals, numbers, period)
    for subject, why in found:
        tally.add("suspect", subject, 1, f"{log.deployment}: {why} (dives counted)")
    found += [
        (one.subject, one.why)
        for one in log.doubts
        if one.start < segment.end and segment.start < one.end
    ]
    return DiveRow(
        deployment=log.deployment,
        platform=log.platform,
        segment=segment,
        signals=signals,
        cells=cells_on_grid(log, segment, period),
        numbers=numbers,
        suspect="; ".join(dict.fromkeys(f"{subject}: {why}" for subject, why in found)),
        positions=row_positions(signals, frame_origin(log, segment), period, driven=driven),
    )


def _report(
    rows: Sequence[DiveRow], kind: str, period: float, files: Sequence[str], tally: Tally
) -> ImportReport:
    """Make the report of at least one row; remove a current that is NaN in all rows from `rows`."""
    for axis in ("north", "east"):  # a store has no variable of only NaN
        if not any(np.isfinite(row.numbers.get(f"dac_{axis}", np.nan)) for row in rows):
            for row in rows:
                row.numbers.pop(f"dac_{axis}", None)
    samples = sum(len(row.signals["measured_gap"]) for row in rows)
    ends = [(row.segment.start_fix, row.segment.end_fix) for row in rows]
    return ImportReport(
        kind=kind,
        files=tuple(files),
        deployments=tuple(dict.fromkeys(row.deployment for row in rows)),
        rows=len(rows),
        rows_with_fixes=sum(None not in both for both in ends),
        suspect=sum(1 for row in rows if row.suspect),
        samples=samples,
        hours=samples * period / 3600.0,
        period=period,
        channels=tuple(n for n in VARIABLES if any(n in row.signals for row in rows)),
        entries=tally.entries(),
        names=tally.named(),
    )


def _outside(channel: Channel, segments: Sequence[LogSegment]) -> NDArray[np.bool_]:
    """True for samples outside all segments."""
    inside = np.zeros(len(channel), bool)
    for segment in segments:
        inside |= (channel.time >= segment.start) & (channel.time <= segment.end)
    return ~inside


def _numbers(log: DeploymentLog, segment: LogSegment, after: float) -> dict[str, float]:
    """Per-row numbers that come from the log."""
    numbers: dict[str, float] = {}
    dive = log.channel("dive").within(segment.start, segment.end)
    if len(dive):
        numbers["dive"] = float(np.median(dive.values))
    middle = np.array([0.5 * (segment.start + segment.end)])
    if len(log.magnetic_variation):
        numbers["magnetic_variation"] = float(log.magnetic_variation.at(middle)[0])
    # the vehicle computes a dive's current after it: take the last before the next dive
    for axis in ("north", "east"):
        reported = log.channel(f"dac_{axis}").within(segment.end - _BEFORE_FIX, after)
        if len(reported):
            numbers[f"vehicle_dac_{axis}"] = float(reported.values[-1])
    if len(log.channel("thruster")):
        on = log.channel("thruster").within(segment.start, segment.end).values > 0.0
        numbers["thruster_fraction"] = float(np.mean(on)) if len(on) else 0.0
    return numbers


_BEFORE_FIX = 1.0
"""[s] Tolerance by which a current stamped with the end fix belongs to the dive before it."""
