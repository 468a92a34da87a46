"""Completion: turn finished shards into a store by writing arrays over missions and metadata.

Besides signals, a store has arrays over missions: every sampled parameter, every constant of the
sensors and the number of failed attempts. An array is left out if all missions have the same fixed
value.

`Marker` records a finished shard, so that no run repeats it.
`note` writes the log beside a store: the machine, time and command of each run.
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
"""Value of an unused integer parameter; unused other parameters are NaN."""
SENSOR_PREFIX = "sensor_"
LENGTH = "mission.duration_h"
"""Parameter without an array of its own, because `duration` holds its values"""
SEGMENT = "segment"
"""Dimension of the parameters that are sampled for every segment"""
DIGEST = 32
"""[byte] Length of the SHA-256 at the start of a marker's file"""
RECIPE_COPY = "recipe"
"""Group whose attributes are a second copy of the recipe; either copy can make the store again."""
FAILURE = "failure"
"""Dimension of the attempts that failed and were replaced"""
FAILED_MISSION, FAILED_ATTEMPT = "failure_mission", "failure_attempt"
FAILED_TIME, FAILED_REASON = "failure_time", "failure_reason"
PLANNED: Mapping[str, Mapping[str, Any]] = {
    SEGMENT: {"long_name": "place of a segment in its mission"},
    names.SPLIT: {
        **flag_attributes("part of the data set", names.SPLITS),
        "comment": "missions are split, never samples",
    },
}
"""CF attributes of the arrays from the plan, except those that every store has"""
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
"""CF attributes of the arrays over failed attempts; a store without failures lacks these arrays."""


class FailedAttempt(NamedTuple):
    """Failed attempt at a mission, which another attempt replaced."""

    mission: int
    attempt: int
    reason: str
    time_s: float | None
    """[s] Time of the first value that was not finite; None: the simulation never started"""


class FlownMission(NamedTuple):
    """Record of one flown mission."""

    mission: int
    attempt: int
    """Number of the attempt that succeeded, from 0"""
    samples: int
    parameters: Parameters
    place: Mapping[str, float | str]
    """Start place and time, with the names of a trajectory's provenance"""
    sensors: Mapping[str, float]
    """Sampled constants of the sensors"""
    failures: tuple[FailedAttempt, ...] = ()


Array = tuple[str, NDArray[Any], Mapping[str, Any]]
"""Name, values over (mission[, segment]) and CF attributes"""


def mission_arrays(recipe: Recipe, missions: Sequence[FlownMission]) -> Iterator[Array]:
    """Yield the arrays over missions, except the plan and parameters that nobody sampled or set."""
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
    """Yield the array of a parameter, unless its preset gives all missions the same value."""
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
    if name not in recipe.changes and not (~blank & (values != usual)).any():
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
    """Return the CF attributes of a constant that is sampled for a mission's sensor."""
    text = "constant of this mission's sensors: " + name.replace("_", " ")
    return {"units": unit, "long_name": text}


def option_names(recipe: Recipe, name: str) -> tuple[str, ...]:
    """Return the words that a parameter can have; stores keep the index of a word."""
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
    """Hash of the recipe"""
    files: dict[str, FileSum]
    """Size and hash of each file of the shard, by key in the tree"""
    missions: list[FlownMission]
    versions: dict[str, str]
    """Versions of all software that can change a bit of a result"""

    def to_bytes(self) -> bytes:
        """Format the marker's file: the SHA-256 of a JSON text, then the text."""
        data = json.dumps(self, default=vars).encode()
        return hashlib.sha256(data).digest() + data

    @classmethod
    def of_bytes(cls, data: bytes) -> Marker:
        """Parse a marker's file; raises ValueError, KeyError or TypeError if it is damaged."""
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
    """Read the marker of a shard; None if it is missing or damaged, so that the shard flies again.

    Raises:
      StoreError: the marker is of another shard or recipe.
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
    """Return the marker of a shard if all its files are in the tree with the right size, else None.
    `sizes`: sizes of the files in the tree by name; None: list the tree."""
    found = read_marker(job, number)
    if found is None:
        return None
    sizes = dict(job.tree.sizes()) if sizes is None else sizes
    return found if all(sizes.get(key) == one.bytes for key, one in found.files.items()) else None


def complete(job: Job) -> None:
    """Write everything in a store except its shards, from the markers. Meanwhile the records of all
    missions, some kB each, are in memory.

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
    """Arrays over failed attempts; empty without failures."""
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
    """Count the failed attempts in a complete store."""
    table = json.loads(files_at(store).read_small(METADATA))["consolidated_metadata"]["metadata"]
    return int(table[FAILED_MISSION]["shape"][0]) if FAILED_MISSION in table else 0


def store_attributes(recipe: Recipe) -> dict[str, Any]:
    """Return the store's own attributes, which depend only on the recipe."""
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
        BESIDE: " ".join(PLACE),  # coordinates over missions, so not named by any signal
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
    """Name of the processor, since processors may round differently."""
    with contextlib.suppress(OSError), Path("/proc/cpuinfo").open(encoding="utf-8") as file:
        for line in file:
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
