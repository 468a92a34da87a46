"""Completion: finished shards into a store: bookkeeping, metadata, checksums.

Run log: which machine made a store, when and by which command, beside the store.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import itertools
import json
import os
import platform
import socket
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.generation.bookkeeping import SEGMENT, Column, FailedAttempt, columns
from factory.generation.job import Job, finished, read_marker
from factory.sampling.recipe import Recipe, sha256, versions
from twin.errors import StoreError
from twin.physics.true_signals import SAMPLE_PERIOD
from twin.records import attributes as names
from twin.records.coordinates import (
    ATTRIBUTES,
    COORDINATE_DTYPES,
    COORDINATES,
    DATETIME,
    FLOWN,
    PLACE,
)
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.storage.sharded import BESIDE, DTYPE, ArrayMeta, ShardedStore, flag_attributes
from twin.records.storage.store_path import FileSum, StorePath, files_at
from twin.version import __version__

RECIPE_COPY = "recipe"
"""Group whose attributes are the recipe once more: either copy is enough to make a store again"""
FAILURE = "failure"
"""Dimension of the attempts that failed and were replaced."""
FAILED_MISSION, FAILED_ATTEMPT = "failure_mission", "failure_attempt"
FAILED_TIME, FAILED_REASON = "failure_time", "failure_reason"
PLANNED: Mapping[str, Mapping[str, Any]] = {
    SEGMENT: {"long_name": "place of a segment in its mission"},
    names.SPLIT: {
        **flag_attributes("part of the data set", names.SPLITS),
        "comment": "missions are split, never samples",
    },
}
"""CF attributes of what the plan says, beside those of every store"""
FAILED: Mapping[str, Mapping[str, Any]] = {
    FAILED_MISSION: {"long_name": "mission that the attempt was for"},
    FAILED_ATTEMPT: {"long_name": "number of the attempt"},
    FAILED_TIME: {
        "units": "s",
        "long_name": "time at which the simulation left the finite numbers",
        "comment": "NaN where it never started",
    },
    FAILED_REASON: {"long_name": "why the attempt failed"},
}
"""CF attributes of the arrays over attempts that failed; a store without any has none of them"""
Part = tuple[str, int, NDArray[Any], ArrayMeta]
"""Name of an array, number and values of a chunk, and the array's metadata."""


@dataclasses.dataclass
class Found:
    """Contents of all shards together."""

    files: dict[str, FileSum]
    used: set[str]
    """columns that say something"""
    segments: int
    """of the mission with most"""
    failures: list[FailedAttempt]


def complete(job: Job) -> int:
    """Write all that is not in the shards; returns how many attempts failed.

    Memory does not grow with the store: rows are moved in chunks of `Layout.row_missions`.

    Raises:
      StoreError: a shard is missing. OSError: the disk refuses.
    """
    recipe, layout = job.recipe, job.layout
    table = columns(recipe)
    found = _survey(job, table)
    target = ShardedStore(
        job.tree,
        missions=layout.missions,
        samples=recipe.plan.samples,
        shard_missions=layout.shard_missions,
        row_missions=layout.row_missions,
    )
    target.sums |= found.files
    used = [column for column in table if column.name in found.used]
    for part in itertools.chain(_planned(job, found), _rows(job, used, found), _failures(found)):
        target.write_rows(*part)
    beside, flown = {BESIDE: " ".join(COORDINATES)}, {key.partition("/")[0] for key in found.files}
    signals: dict[str, tuple[np.dtype[Any], Mapping[str, Any]]] = {
        name: (DTYPE, {**variable.stored_attributes(), **beside})
        for name, variable in VARIABLES.items()
        if name in flown
    }
    for name in COORDINATES:
        said = {} if name == DATETIME else FLOWN
        signals[name] = (COORDINATE_DTYPES[name], {**ATTRIBUTES[name], **said})
    target.write_group(RECIPE_COPY, recipe.document())
    target.finish(signals, store_attributes(recipe))
    return len(found.failures)


def _survey(job: Job, table: list[Column]) -> Found:
    """A first look at all shards."""
    found, sizes = Found({}, set(), 0, []), dict(job.tree.sizes())
    for number in job.layout.shards:
        marker = finished(job, number, sizes)
        if marker is None:
            raise StoreError(f"shard {number} is missing; --resume makes it")
        found.files |= marker.files
        found.failures += marker.failures
        for column in table:
            values = marker.rows[column.name]
            if column.per_segment:
                found.segments = max(found.segments, values.shape[1])
            if column.name not in found.used and column.says_something(values):
                found.used.add(column.name)
    return found


def _planned(job: Job, found: Found) -> Iterator[Part]:
    """Coordinates, and what the plan says of each mission."""
    plan, size = job.recipe.plan, job.layout.row_missions
    whole: dict[str, tuple[str, NDArray[Any]]] = {
        TIME: (TIME, np.arange(plan.samples) * SAMPLE_PERIOD),
        SEGMENT: (SEGMENT, np.arange(found.segments)),
        MISSION: (MISSION, np.arange(len(plan))),
        names.DURATION: (MISSION, np.array(plan.durations_s)),
        names.SPLIT: (MISSION, np.array(plan.splits, np.int8)),
    }
    described = {**names.AXES, **names.OF_MISSIONS, **PLANNED}
    for name, (dimension, values) in whole.items():
        meta = ArrayMeta(values.shape, values.dtype, (dimension,), described[name])
        step = size if dimension == MISSION else max(1, len(values))
        for number, first in enumerate(range(0, len(values), step)):
            yield name, number, values[first : first + step], meta


def _rows(job: Job, table: list[Column], found: Found) -> Iterator[Part]:
    """The columns that say something, chunk by chunk."""
    layout, width = job.layout, found.segments
    shards_per_chunk = -(-layout.row_missions // layout.shard_missions)
    for number, first in enumerate(range(0, len(layout.shards), shards_per_chunk)):
        markers = []
        for shard in layout.shards[first : first + shards_per_chunk]:
            marker = read_marker(job, shard)
            if marker is None:
                raise StoreError(f"the marker of shard {shard} has disappeared; --resume makes it")
            markers.append(marker)
        for column in table:
            parts = [marker.rows[column.name] for marker in markers]
            shape: tuple[int, ...] = (layout.missions,)
            dimensions: tuple[str, ...] = (MISSION,)
            if column.per_segment:  # filled up to the mission with most segments
                shape, dimensions = (*shape, width), (MISSION, SEGMENT)
                parts = [
                    np.pad(one, ((0, 0), (0, width - one.shape[1])),
                           constant_values=one.dtype.type(column.empty))
                    for one in parts
                ]  # fmt: skip
            values = np.concatenate(parts)
            yield (
                column.name,
                number,
                values,
                ArrayMeta(shape, values.dtype, dimensions, column.attributes),
            )


def _failures(found: Found) -> Iterator[Part]:
    """The attempts that failed; no arrays where none did."""
    if not found.failures:
        return
    mission, attempt, reason, time = zip(*found.failures, strict=True)
    whole: dict[str, NDArray[Any]] = {
        FAILED_MISSION: np.array(mission),
        FAILED_ATTEMPT: np.array(attempt, np.int16),
        FAILED_TIME: np.array([np.nan if t is None else t for t in time]),
        FAILED_REASON: np.array(reason, np.dtypes.StringDType()),
    }
    for name, values in whole.items():
        yield name, 0, values, ArrayMeta(values.shape, values.dtype, (FAILURE,), FAILED[name])


def store_attributes(recipe: Recipe) -> dict[str, Any]:
    """The store's own attributes, the same for equal recipes."""
    return {
        names.SOURCE: f"simulation, vehicle {recipe.vehicle.name} in MuJoCo",
        names.PRESET: recipe.preset,
        names.SEED: recipe.seed,
        names.HOURS: recipe.plan.hours,
        names.SETTINGS: json.dumps(recipe.describe()),
        names.CHANGES: json.dumps(dict(recipe.changes)),
        names.SENSORS: recipe.sensor_preset,
        names.VEHICLE_MJCF: recipe.vehicle.xml,
        names.VEHICLE_SHA256: sha256(recipe.vehicle.xml),
        names.RECIPE: recipe.digest,
        BESIDE: " ".join(PLACE),  # of no signal: of the store
        names.HISTORY: f"factory generate of glider-twin {__version__}, recipe {recipe.digest}",
    }


def note(store: StorePath, recipe: Recipe, command: str) -> None:
    """Add a line to the log of a store, `NAME.log`; raises OSError."""
    entry = {
        "time": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "command": command,
        "recipe": recipe.digest,
        "host": socket.gethostname(),
        "processor": _processor(),
        "processors": os.cpu_count(),
        "versions": versions(recipe.vehicle),
    }
    line, log = json.dumps(entry) + "\n", store.with_name(store.name + ".log")
    if isinstance(log, Path):
        with log.open("a", encoding="utf-8") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
    else:
        name = f"{entry['time']}-{entry['host']}-{os.getpid()}.json"
        files_at(log).write(name, line.encode())


def _processor() -> str:
    """Name of the processor, which may decide how numbers round."""
    with contextlib.suppress(OSError), Path("/proc/cpuinfo").open(encoding="utf-8") as file:
        for line in file:
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
