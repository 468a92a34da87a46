"""Assemble: parts into shards, and the arrays and metadata that complete a store."""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.generation.checkpoint import Journal, write_whole
from factory.generation.chunk import checksum, shard
from factory.generation.mission_record import Record
from factory.generation.store_layout import (
    SEGMENT,
    flag_attributes,
    group_metadata,
    shard_missions,
    signal_metadata,
    small_metadata,
    split_attributes,
)
from factory.recipe.distribution import Choice, Fixed, Value
from factory.recipe.parameter import Parameter
from factory.recipe.recipe import Recipe, sha256
from factory.recipe.sampling import KINDS
from twin.errors import StoreError
from twin.physics.scenario import SAMPLE_PERIOD
from twin.records.schema import MISSION, TIME, VARIABLES

UNUSED_CODE = -1
"""Stands in integer parameters where NaN stands in the others."""
SENSOR_PREFIX = "sensor_"


def shards(recipe: Recipe) -> range:
    """Numbers of all shards."""
    return range(-(-len(recipe.plan) // shard_missions(len(recipe.plan))))


def shard_range(recipe: Recipe, number: int) -> range:
    """Missions of one shard."""
    size = shard_missions(len(recipe.plan))
    return range(number * size, min((number + 1) * size, len(recipe.plan)))


def write_shard(recipe: Recipe, journal: Journal, number: int) -> list[Record]:
    """Move the parts of a shard into the store's arrays.

    Raises:
      StoreError: a part has disappeared.
    """
    missions = shard_range(recipe, number)
    parts = [journal.read_part(mission) for mission in missions]
    records, chunks = [], []
    for mission, part in zip(missions, parts, strict=True):
        if part is None:
            raise StoreError(f"mission {mission} has disappeared from {journal.folder}; --resume")
        records.append(part[0])
        chunks.append(part[1])
    for name in chunks[0]:
        packed: list[bytes | None] = [mission_chunks[name] for mission_chunks in chunks]
        packed += [None] * (shard_missions(len(recipe.plan)) - len(packed))
        folder = journal.store / name / "c" / str(number)
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / "0", shard(packed))
    journal.write_shard_note(number, records)
    journal.drop_parts(missions)
    return records


@dataclass(frozen=True)
class Small:
    """An array that is not a signal."""

    values: NDArray[Any]
    dimensions: tuple[str, ...]
    attributes: Mapping[str, Any]


def finish_store(recipe: Recipe, store: Path, records: Sequence[Record], history: str) -> None:
    """Write everything but the signals; `zarr.json` of the store comes last."""
    arrays: dict[str, Any] = {}
    for name, small in small_arrays(recipe, records).items():
        arrays[name] = small_metadata(small.values, small.dimensions, small.attributes)
        data = np.ascontiguousarray(small.values).tobytes()
        chunk = store / name / "c" / "/".join("0" * small.values.ndim)
        chunk.parent.mkdir(parents=True, exist_ok=True)
        write_whole(chunk, data + checksum(data))
    for name, variable in VARIABLES.items():
        if (store / name / "c").is_dir():
            arrays[name] = signal_metadata(variable, len(recipe.plan), recipe.plan.samples)
    for name, metadata in arrays.items():
        write_whole(store / name / "zarr.json", compact_json(metadata))
    group = group_metadata(attributes(recipe, records, history), arrays)
    write_whole(store / "zarr.json", compact_json(group))


def compact_json(value: Mapping[str, Any]) -> bytes:
    """JSON without white space: a small store is mostly metadata."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()


def small_arrays(recipe: Recipe, records: Sequence[Record]) -> dict[str, Small]:
    """Coordinates, bookkeeping, drawn parameters and sensor constants."""
    plan = recipe.plan
    by_mission = (MISSION,)
    longest = max(len(record.parameters.segments) for record in records)
    small = {
        MISSION: Small(np.arange(len(plan)), by_mission, {"long_name": "mission index"}),
        TIME: Small(
            np.arange(plan.samples) * SAMPLE_PERIOD,
            (TIME,),
            {"units": "s", "long_name": "time since the start of the mission"},
        ),
        SEGMENT: Small(
            np.arange(longest), (SEGMENT,), {"long_name": "place of a segment in its mission"}
        ),
        "n_samples": Small(
            np.array([record.samples for record in records], np.int32),
            by_mission,
            {"units": "1", "long_name": "samples of the mission; later ones are padding"},
        ),
        "duration": Small(
            np.array(plan.durations_s), by_mission, {"units": "s", "long_name": "mission length"}
        ),
        "split": Small(np.array(plan.splits, np.int8), by_mission, split_attributes()),
        "attempt": Small(
            np.array([record.attempt for record in records], np.int16),
            by_mission,
            {"units": "1", "long_name": "attempts that failed before this one"},
        ),
    }
    for name, parameter in recipe.table.items():
        array = _parameter_array(recipe, name, parameter, records, longest)
        if array is not None:
            small[parameter.variable] = array
    for name, unit in recipe.suite.drawn_units().items():
        values = np.array([record.sensors.get(name, 0.0) for record in records])
        if values.any():
            text = "constant of this mission's sensors: " + name.replace("_", " ")
            small[SENSOR_PREFIX + name] = Small(
                values, by_mission, {"units": unit, "long_name": text}
            )
    return small


def _parameter_array(
    recipe: Recipe, name: str, parameter: Parameter, records: Sequence[Record], longest: int
) -> Small | None:
    """One parameter of all missions; None when it is the same fixed value in all of them."""
    if name == "mission.duration_h":
        return None  # the array `duration` has it
    distribution = recipe.distributions[name]
    if parameter.per_segment:
        rows = [[segment[name] for segment in r.parameters.segments] for r in records]
        used = any(value == value for row in rows for value in row)
    else:
        rows = [[r.parameters.values[name]] for r in records]
        first = distribution.value if isinstance(distribution, Fixed) else None
        used = any(value == value and value != first for row in rows for value in row)
    if not used:
        return None
    attributes: dict[str, Any] = {
        "units": parameter.unit,
        "long_name": parameter.why,
        "distribution": distribution.text(),
        "parameter": name,
    }
    meanings = option_names(recipe, name)
    if meanings:
        attributes = {**attributes, **flag_attributes(parameter.why, meanings, 0)}
        del attributes["units"]
        filled = np.full((len(rows), longest), UNUSED_CODE, np.int8)
        for i, row in enumerate(rows):
            filled[i, : len(row)] = [_code(value, meanings) for value in row]
    else:
        filled = np.full((len(rows), longest), np.nan)
        for i, row in enumerate(rows):
            filled[i, : len(row)] = row
    if parameter.per_segment:
        return Small(filled, (MISSION, SEGMENT), attributes)
    return Small(filled[:, 0], (MISSION,), attributes)


def option_names(recipe: Recipe, name: str) -> tuple[str, ...]:
    """The words that a parameter can be; stores keep their positions."""
    if name == "mission.kind":
        return KINDS
    distribution = recipe.distributions[name]
    if isinstance(distribution, Choice):
        return tuple(option for option in distribution.options if isinstance(option, str))
    return ()


def _code(value: Value, meanings: Sequence[str]) -> int:
    return meanings.index(value) if isinstance(value, str) else UNUSED_CODE


def attributes(recipe: Recipe, records: Sequence[Record], history: str) -> dict[str, Any]:
    """The store's own attributes; all but `history` are the same for equal recipes."""
    failed = [
        {"mission": record.mission, **_failure(failure)}
        for record in records
        for failure in record.failures
    ]
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {
        "source": f"simulation, vehicle {recipe.vehicle.name} in MuJoCo",
        "preset": recipe.preset,
        "seed": recipe.seed,
        "hours": recipe.plan.hours,
        "settings": json.dumps(recipe.describe()),
        "changes": json.dumps(dict(recipe.changes)),
        "sensors": recipe.sensor_preset,
        "vehicle_mjcf": recipe.vehicle.xml,
        "vehicle_sha256": sha256(recipe.vehicle.xml),
        "failed_missions": json.dumps(failed, allow_nan=False),
        "history": f"{now}: {history}",
    }


def _failure(failure: Any) -> dict[str, Any]:
    def plain(values: Mapping[str, Value]) -> dict[str, Value | None]:
        return {name: value if value == value else None for name, value in values.items()}

    return {
        "attempt": failure.attempt,
        "reason": failure.reason,
        "time_s": failure.time_s,
        "parameters": plain(failure.values),
        "segments": [plain(segment) for segment in failure.segments],
    }
