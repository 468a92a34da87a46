"""Parcels: a log that comes by the piece, each piece read with its neighbours in time.

A dive may begin in one file and end in the next, and the fix before it is often in the file before.
So a parcel is read together with some before and after it; it owns the dives whose middle lies
between its own begin and the next one's. What is cut depends on these alone, however many there are
and in whatever order they came.

A file that grows is read whole, for what it said before may have been corrected. Its dives are made
of parts of the log in the same way, and those whose part is as it was are taken over.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import zipfile
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from factory.importing.deployment_log import Channel, DeploymentLog, joined
from factory.importing.dives.dive_rows import DiveRow
from factory.importing.dives.dive_store import row_of, rows_of, segmented
from factory.importing.dives.positions import Positions
from factory.importing.dives.regular_times import HELD, KNOWN_FROM, not_empty
from factory.importing.dives.segments import LogSegment
from factory.importing.formats.base import IMPORTERS, Importer, ReadOptions
from factory.importing.gps_fixes import tell_read
from factory.importing.import_run import read_logs
from factory.importing.plausibility import DiveRules
from factory.importing.tally import Entry, Tally
from twin.records.schema import VARIABLES
from twin.version import __version__

Carried = Mapping[str, Mapping[str, tuple[float, float]]]
"""Time [s] unix and value that holds since, by deployment and channel"""
BESIDE = frozenset({"waypoint_latitude", "waypoint_longitude", "thruster"})
"""Channels that hold and that a store does not keep as they are"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Owned:
    """What a parcel's window holds."""

    rows: tuple[DiveRow, ...]
    """The parcel's own dives"""
    files: tuple[str, ...]
    deployments: tuple[str, ...]
    period: float
    """[s] between samples"""
    models: tuple[str, ...]
    """Vehicle files that stand for the vehicles"""
    simulated: bool
    by_depth: bool
    """Whether rows are dives"""
    said: str | None
    """What people said of the deployment"""
    last: Carried
    """Values that hold when the next parcel begins"""


def owned_rows(
    kind: str,
    files: Sequence[Path],
    options: ReadOptions,
    own: tuple[float, float],
    carried: Carried,
    tally: Tally,
) -> Owned:
    """The dives of a parcel.

    Args:
      kind: of the logs.
      files: the parcel's, and those of its neighbours in time.
      own: [s] unix, from when on dives are its own, and from when on the next one's.
      carried: values that held when the first of these files began.
      tally: counts what is done, to the neighbours too.

    Raises:
      InputError: nothing can be read, or it has neither pressure nor depth.
    """
    importer = IMPORTERS[kind]
    _, logs = read_logs(kind, files, options, tally)
    tell_read(logs, tally)
    period = _period(logs, importer)
    rows: list[DiveRow] = []
    last = dict(carried)
    holds = HELD | KNOWN_FROM | importer.held | BESIDE
    for log in sorted((log for log in logs if log.channels), key=lambda one: one.span):
        log = _with_carried(log, carried.get(log.deployment, {}))
        last[log.deployment] = _last(log, holds, own[1])
        found, _ = rows_of(
            log, period=period, rules=DiveRules(), tally=tally, held=importer.held,
            own=lambda segment: own[0] <= 0.5 * (segment.start + segment.end) < own[1],
        )  # fmt: skip
        rows += found
    return _owned(rows, logs, period, last)


Known = Callable[[str], DiveRow | None]
"""The dive that was made of a part of a log before, by the part's digest"""


def grown_rows(
    kind: str, files: Sequence[Path], options: ReadOptions, tally: Tally, known: Known
) -> Owned:
    """The dives of files that grow: each is made of a part of the log that begins with the dive
    before it and ends with the one after it. What is known of a part is not made again.

    Raises:
      InputError: nothing can be read, or it has neither pressure nor depth.
    """
    importer, rules = IMPORTERS[kind], DiveRules()
    _, logs = read_logs(kind, files, options, tally)
    tell_read(logs, tally)
    period = _period(logs, importer)
    rows: list[DiveRow] = []
    holds = HELD | KNOWN_FROM | importer.held | BESIDE
    for log in sorted((log for log in logs if log.channels), key=lambda one: one.span):
        whole, segments = segmented(log, rules, tally)
        segments = not_empty(whole, segments, period, tally)
        cutting: dict[str, Any] = {"period": period, "rules": rules, "held": importer.held}
        for number, segment in enumerate(segments):
            before, after = segments[max(number - 1, 0)], segments[number + 1 : number + 2]
            begin = before.start if number else -np.inf
            part = _with_carried(
                _part(log, begin, after[0].end if after else np.inf), _last(log, holds, begin)
            )
            digest = _digest(part, segment, period)
            row = known(digest)
            if row is None:
                told = Tally()
                its, found = segmented(part, rules, Tally())
                middle = 0.5 * (segment.start + segment.end)
                own = [k for k, one in enumerate(found) if one.start <= middle < one.end]
                # a part that is cut otherwise than the whole says less than the whole
                given = (its, found, own[0]) if len(own) == 1 else (whole, segments, number)
                row = dataclasses.replace(
                    row_of(*given, tally=told, **cutting),
                    made_of=digest if len(own) == 1 else "",
                    told=told.entries(),
                )
            for entry in row.told:
                tally.add(entry.action, entry.subject, entry.count, entry.detail)
            rows.append(row)
    return _owned(rows, logs, period, {})


def _period(logs: Sequence[DeploymentLog], importer: Importer) -> float:
    return min((log.period for log in logs if log.period), default=importer.period)


def _owned(
    rows: Sequence[DiveRow], logs: Sequence[DeploymentLog], period: float, last: Carried
) -> Owned:
    return Owned(
        rows=tuple(rows),
        files=tuple(sorted({name for log in logs for name in log.files})),
        deployments=tuple(sorted({log.deployment for log in logs})),
        period=period,
        models=tuple(sorted({log.model for log in logs if log.model is not None})),
        simulated=any(log.simulated for log in logs),
        by_depth=any(log.pieces is None for log in logs),
        said=logs[0].said if len(logs) == 1 else None,
        last=last,
    )


def _part(log: DeploymentLog, begin: float, end: float) -> DeploymentLog:
    """What a log says from one time to another [s], both included."""

    def cut(channels: Mapping[str, Channel]) -> dict[str, Channel]:
        every = {name: one.within(begin, end) for name, one in channels.items()}
        return {name: one for name, one in every.items() if len(one)}

    spans, known = log.pieces, log.magnetic_variation
    first = max(int(np.searchsorted(known.time, begin)) - 1, 0)  # it holds between its samples
    last = int(np.searchsorted(known.time, end)) + 1
    return dataclasses.replace(
        log,
        channels=cut(log.channels),
        auxiliary=cut(log.auxiliary),
        fixes=log.fixes.within(begin, end),
        magnetic_variation=Channel(known.time[first:last], known.values[first:last]),
        pieces=None if spans is None else tuple(s for s in spans if begin <= s[0] and s[1] <= end),
    )


def _digest(part: DeploymentLog, segment: LogSegment, period: float) -> str:
    """Of all that a dive's row is made of."""
    every = {**part.channels, **part.auxiliary, "variation": part.magnetic_variation}
    said = [
        __version__, period, segment.start, segment.end, part.deployment, part.platform,
        part.station, part.gridded, part.period, sorted(part.held), part.pieces, sorted(every),
    ]  # fmt: skip
    found = hashlib.sha256(json.dumps(said).encode())
    arrays = [values for _, one in sorted(every.items()) for values in (one.time, one.values)]
    for values in (*arrays, part.fixes.time, part.fixes.latitude, part.fixes.longitude):
        found.update(np.ascontiguousarray(values).data)
    return found.hexdigest()


def _with_carried(log: DeploymentLog, carried: Mapping[str, tuple[float, float]]) -> DeploymentLog:
    channels, auxiliary = dict(log.channels), dict(log.auxiliary)
    for name, (time, value) in carried.items():
        there = auxiliary if name in BESIDE else channels
        before = Channel(np.array([time]), np.array([value]))
        there[name] = joined([before, there[name]]) if name in there else before
    return dataclasses.replace(log, channels=channels, auxiliary=auxiliary)


def _last(log: DeploymentLog, names: Collection[str], end: float) -> dict[str, tuple[float, float]]:
    """The last value of each of these channels before a time [s]."""
    found = {}
    for name in sorted(names):
        channel = log.channel(name)
        count = int(np.searchsorted(channel.time, end))
        if count:
            found[name] = (float(channel.time[count - 1]), float(channel.values[count - 1]))
    return found


def write_rows(rows: Sequence[DiveRow], said: Mapping[str, Any], path: Path) -> None:
    """Keep dives as a store would have them, with what is said of them.

    Args:
      said: JSON-able.

    Raises:
      OSError: the disk refuses.
    """
    arrays: dict[str, Any] = {}
    heads = []
    for k, row in enumerate(rows):
        signals = {
            name: np.asarray(values, np.float32)
            for name, values in row.signals.items()
            if name in VARIABLES and np.isfinite(values).any()
        }
        for name, values in signals.items():
            arrays[f"{k}/{name}"] = values
        arrays[f"{k}/latitude"] = np.asarray(row.positions.latitude, np.float64)
        arrays[f"{k}/longitude"] = np.asarray(row.positions.longitude, np.float64)
        segment = dataclasses.asdict(row.segment)
        del segment["inside"]
        heads.append(
            {
                "deployment": row.deployment,
                "platform": row.platform,
                "segment": segment,
                "numbers": {n: float(v) for n, v in row.numbers.items() if np.isfinite(v)},
                "signals": list(signals),
                "method": row.positions.method,
                "made_of": row.made_of,
                "told": [dataclasses.astuple(one) for one in row.told],
            }
        )
    head = json.dumps({**said, "rows": heads}).encode()
    with path.open("wb") as file:
        np.savez(file, head=np.frombuffer(head, np.uint8), **arrays)


def read_head(path: Path) -> dict[str, Any] | None:
    """What `write_rows` was told, with the heads of the dives; None: no such file, or damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            found: dict[str, Any] = json.loads(file["head"].tobytes())
            return found
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def read_rows(path: Path, chosen: Collection[int] | None = None) -> list[DiveRow]:
    """The dives that `write_rows` kept, or some of them by their place.

    Raises:
      OSError, ValueError, KeyError, zipfile.BadZipFile: damaged.
    """
    rows = []
    with np.load(path, allow_pickle=False) as file:
        heads = json.loads(file["head"].tobytes())["rows"]
        for k, head in enumerate(heads):
            if chosen is not None and k not in chosen:
                continue
            segment: dict[str, Any] = {
                name: tuple(value) if isinstance(value, list) else value
                for name, value in head["segment"].items()
            }
            rows.append(
                DiveRow(
                    deployment=head["deployment"],
                    platform=head["platform"],
                    segment=LogSegment(**segment),
                    signals={name: file[f"{k}/{name}"] for name in head["signals"]},
                    numbers=head["numbers"],
                    positions=Positions(
                        latitude=file[f"{k}/latitude"],
                        longitude=file[f"{k}/longitude"],
                        method=head["method"],
                    ),
                    made_of=head["made_of"],
                    told=tuple(Entry(*one) for one in head["told"]),
                )
            )
    return rows
