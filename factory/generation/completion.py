"""Completion: finished shards into a store: what it keeps of each mission, metadata, checksums.

Beside its signals a store has arrays over missions: every drawn parameter, every constant of the
sensors, how many attempts it took. Those that say nothing, because all missions have the same fixed
value, are left out.

Marker: record of a finished shard, so that it is neither repeated nor mistaken.
Run log: which machine made a store, when and by which command, beside the store.
"""

from __future__ import annotations

import contextlib
import datetime
import hashlib
import json
import os
import platform
import socket
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.generation.job import Job
from factory.sampling.distribution import Choice, Fixed
from factory.sampling.draw import Parameters
from factory.sampling.mission_kinds import kinds_for
from factory.sampling.recipe import Recipe, sha256, versions
from twin.bounded import FREE_BYTES
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
    place_arrays,
)
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.storage.sharded import BESIDE, DTYPE, METADATA, ShardedStore, flag_attributes
from twin.records.storage.store_path import FileSum, StorePath, files_at
from twin.version import __version__

UNUSED_CODE = -1
"""Stands in integer parameters where NaN stands in the others."""
SENSOR_PREFIX = "sensor_"
LENGTH = "mission.duration_h"
"""The parameter that has no array of its own: `duration` has it"""
SEGMENT = "segment"
"""Dimension of the parameters that are drawn for every segment."""
DIGEST = 32
"""[byte] of a marker's SHA-256, with which its file begins"""
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


class FailedAttempt(NamedTuple):
    """An attempt that had to be replaced, as JSON lists and the arrays of a store have it."""

    mission: int
    attempt: int
    reason: str
    time_s: float | None
    """[s] when the simulation left the finite numbers; None: it never started"""


class FlownMission(NamedTuple):
    """One mission as it was made."""

    mission: int
    attempt: int
    """the attempt that succeeded, from 0"""
    samples: int
    parameters: Parameters
    place: Mapping[str, float | str]
    """where and when it began, as a trajectory's provenance says it"""
    sensors: Mapping[str, float]
    """the sensors' constants"""
    failures: tuple[FailedAttempt, ...] = ()


Array = tuple[str, NDArray[Any], Mapping[str, Any]]
"""Name, values over (mission[, segment]) and CF attributes"""


def mission_arrays(recipe: Recipe, missions: Sequence[FlownMission]) -> Iterator[Array]:
    """Arrays over missions of a store, without those of its plan and those that say nothing."""
    counted: dict[str, NDArray[Any]] = {
        names.N_SAMPLES: np.array([flown.samples for flown in missions], np.int32),
        names.ATTEMPT: np.array([flown.attempt for flown in missions], np.int16),
    }
    for name, values in counted.items():
        yield name, values, names.OF_MISSIONS[name]
    for name, (_, values, attributes) in place_arrays([flown.place for flown in missions]).items():
        yield name, values, attributes
    for name in recipe.table:
        if name != LENGTH:
            yield from _parameter(recipe, name, missions)
    for name, unit in recipe.suite.drawn_units().items():
        values = np.array([flown.sensors.get(name, 0.0) for flown in missions])
        if np.nan_to_num(values).any():
            yield SENSOR_PREFIX + name, values, constant_attributes(name, unit)


def _parameter(recipe: Recipe, name: str, missions: Sequence[FlownMission]) -> Iterator[Array]:
    """The array of a parameter, unless all missions have the same fixed value."""
    parameter, distribution = recipe.table[name], recipe.distributions[name]
    words = option_names(recipe, name)
    fixed = distribution.value if isinstance(distribution, Fixed) else None
    if isinstance(fixed, str) and not words:
        return
    if parameter.per_segment:
        drawn = [[one[name] for one in flown.parameters.segments] for flown in missions]
    else:
        drawn = [[flown.parameters.values[name]] for flown in missions]
    empty, kind = (UNUSED_CODE, np.int8) if words else (np.nan, np.float64)
    values: NDArray[Any] = np.full((len(drawn), max(map(len, drawn))), empty, kind)
    for i, row in enumerate(drawn):
        if words:
            row = [UNUSED_CODE if isinstance(v, float) else words.index(v) for v in row]
        values[i, : len(row)] = row
    usual = fixed if isinstance(fixed, float) and not parameter.per_segment else np.nan
    blank = values == UNUSED_CODE if words else np.isnan(values)
    if not (~blank & (values != usual)).any():
        return
    attributes: dict[str, Any] = {
        "units": parameter.unit,
        "long_name": parameter.long_name,
        "distribution": distribution.text(),
        "parameter": name,
    }
    if parameter.why:
        attributes["comment"] = parameter.why
    if words:
        attributes |= flag_attributes(parameter.long_name, words)
        del attributes["units"]
    yield parameter.variable, values if parameter.per_segment else values[:, 0], attributes


def constant_attributes(name: str, unit: str) -> dict[str, Any]:
    """CF attributes of a constant that a sensor draws for a mission."""
    text = "constant of this mission's sensors: " + name.replace("_", " ")
    return {"units": unit, "long_name": text}


def option_names(recipe: Recipe, name: str) -> tuple[str, ...]:
    """The words that a parameter can be; stores keep their positions."""
    if name == "mission.kind":
        return kinds_for(recipe.vehicle)
    distribution = recipe.distributions[name]
    if isinstance(distribution, Choice):
        return tuple(option for option in distribution.options if isinstance(option, str))
    return ()


class Marker(NamedTuple):
    """Record of a finished shard."""

    number: int
    recipe: str
    """hash of the recipe"""
    files: dict[str, FileSum]
    """by key in the tree"""
    missions: list[FlownMission]
    versions: dict[str, str]
    """of what can change a bit of a result"""

    def to_bytes(self) -> bytes:
        """As it is kept: SHA-256 of the rest, which is JSON."""
        data = json.dumps(self, default=vars).encode()
        return hashlib.sha256(data).digest() + data

    @classmethod
    def of_bytes(cls, data: bytes) -> Marker:
        """Read a marker; raises ValueError, KeyError or TypeError where the file is damaged."""
        if hashlib.sha256(data[DIGEST:]).digest() != data[:DIGEST]:
            raise ValueError("it does not have its own digest")
        shard, recipe, files, missions, versions = json.loads(data[DIGEST:])
        flown = [
            FlownMission(
                number,
                attempt,
                samples,
                Parameters(**{**made, "segments": tuple(made["segments"])}),
                place,
                sensors,
                tuple(FailedAttempt(*one) for one in failures),
            )
            for number, attempt, samples, made, place, sensors, failures in missions
        ]
        sums = {key: FileSum(*one) for key, one in files.items()}
        return cls(shard, recipe, sums, flown, versions)


def read_marker(job: Job, number: int) -> Marker | None:
    """The marker of a shard; None when there is none, or a damaged one: the shard is flown again.

    Raises:
      StoreError: it is that of another shard or recipe.
    """
    key = job.marker(number)
    try:
        found = Marker.of_bytes(job.files.read_small(key, FREE_BYTES))
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    if (found.number, found.recipe) != (number, job.digest):
        raise StoreError(
            f"{job.files.name}/{key} is of shard {found.number} of recipe {found.recipe[:12]}, "
            f"expected is {number} of recipe {job.digest[:12]}: remove that folder, or use another "
            "--out"
        )
    return found


def finished(job: Job, number: int, sizes: Mapping[str, int] | None = None) -> Marker | None:
    """The marker of a shard whose files are all in the tree, by the `sizes` there, which are listed
    where none are given; else None."""
    found = read_marker(job, number)
    if found is None:
        return None
    sizes = dict(job.tree.sizes()) if sizes is None else sizes
    return found if all(sizes.get(key) == one.bytes for key, one in found.files.items()) else None


def complete(job: Job) -> None:
    """Write all that is not in the shards; what they say of each mission, some kB, is in memory
    meanwhile.

    Raises:
      StoreError: a shard is missing. OSError: the disk refuses.
    """
    recipe, layout, plan = job.recipe, job.layout, job.recipe.plan
    target = ShardedStore(
        job.tree,
        missions=layout.missions,
        samples=plan.samples,
        shard_missions=layout.shard_missions,
        row_missions=layout.row_missions,
    )
    sizes, missions = dict(job.tree.sizes()), list[FlownMission]()
    for shard in layout.shards:
        marker = finished(job, shard, sizes)
        if marker is None:
            raise StoreError(f"shard {shard} is missing; --resume makes it")
        target.sums |= marker.files
        missions += marker.missions
    flown = {key.partition("/")[0] for key in target.sums}
    segments = max(len(one.parameters.segments) for one in missions)
    planned: dict[str, tuple[str, NDArray[Any]]] = {
        TIME: (TIME, np.arange(plan.samples) * SAMPLE_PERIOD),
        SEGMENT: (SEGMENT, np.arange(segments)),
        MISSION: (MISSION, np.arange(len(plan))),
        names.DURATION: (MISSION, np.array(plan.durations_s)),
        names.SPLIT: (MISSION, np.array(plan.splits, np.int8)),
    }
    described = {**names.AXES, **names.OF_MISSIONS, **PLANNED}
    for name, (dimension, values) in planned.items():
        target.write_rows(name, (dimension,), values, described[name])
    for name, values, attributes in mission_arrays(recipe, missions):
        target.write_rows(name, (MISSION, SEGMENT)[: values.ndim], values, attributes)
    for name, values in _failures(missions).items():
        target.write_rows(name, (FAILURE,), values, FAILED[name])
    beside = {BESIDE: " ".join(COORDINATES)}
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


def _failures(missions: Sequence[FlownMission]) -> dict[str, NDArray[Any]]:
    """The attempts that failed; no arrays where none did."""
    failures = [failure for one in missions for failure in one.failures]
    if not failures:
        return {}
    mission, attempt, reason, time = zip(*failures, strict=True)
    return {
        FAILED_MISSION: np.array(mission),
        FAILED_ATTEMPT: np.array(attempt, np.int16),
        FAILED_TIME: np.array([np.nan if t is None else t for t in time]),
        FAILED_REASON: np.array(reason, np.dtypes.StringDType()),
    }


def failures_in(store: StorePath) -> int:
    """Attempts that failed and were replaced, in a complete store."""
    table = json.loads(files_at(store).read_small(METADATA))["consolidated_metadata"]["metadata"]
    return int(table[FAILED_MISSION]["shape"][0]) if FAILED_MISSION in table else 0


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
