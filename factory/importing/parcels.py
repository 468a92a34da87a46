"""Parcels: a log that comes by the piece, each piece read with its neighbours in time.

A dive may begin in one file and end in the next, and the fix before it is often in the file before.
So a parcel is read together with some before and after it; it owns the dives whose middle lies
between its own begin and the next one's. What is cut depends on these alone, however many there are
and in whatever order they came.
"""

from __future__ import annotations

import dataclasses
import json
import zipfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from factory.importing.deployment_log import Channel, DeploymentLog, joined
from factory.importing.dives.dive_rows import DiveRow
from factory.importing.dives.dive_store import rows_of
from factory.importing.dives.positions import Positions
from factory.importing.dives.regular_times import HELD, KNOWN_FROM
from factory.importing.dives.segments import LogSegment
from factory.importing.formats.base import IMPORTERS, ReadOptions
from factory.importing.gps_fixes import tell_read
from factory.importing.import_run import read_logs
from factory.importing.plausibility import DiveRules
from factory.importing.tally import Tally
from twin.records.schema import VARIABLES

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
    period = min((log.period for log in logs if log.period), default=importer.period)
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


def read_rows(path: Path) -> list[DiveRow]:
    """The dives that `write_rows` kept.

    Raises:
      OSError, ValueError, KeyError, zipfile.BadZipFile: damaged.
    """
    rows = []
    with np.load(path, allow_pickle=False) as file:
        heads = json.loads(file["head"].tobytes())["rows"]
        for k, head in enumerate(heads):
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
                )
            )
    return rows
