"""Shards: finished missions into the store's arrays, and what else a complete store holds."""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.flight.mission_place import mission_coordinates, mission_place
from factory.generation.checkpoint import Checkpoint
from factory.generation.flown_mission import FailedAttempt, FlownMission
from factory.recipe.distribution import Choice, Fixed, Value
from factory.recipe.kinds import kinds_for
from factory.recipe.parameter import Parameter
from factory.recipe.recipe import Recipe, sha256
from twin.errors import StoreError
from twin.physics.scenario import SAMPLE_PERIOD
from twin.records import attributes as names
from twin.records.attributes import SPLITS
from twin.records.place import COORDINATES, padded, place_arrays
from twin.records.schema import MISSION, TIME
from twin.records.sharded import (
    DTYPE,
    ShardedStore,
    SmallArray,
    flag_attributes,
    shard_missions,
)

UNUSED_CODE = -1
"""Stands in integer parameters where NaN stands in the others."""
SENSOR_PREFIX = "sensor_"
SEGMENT = "segment"
"""Dimension of the parameters that are drawn for every segment."""


def shards(recipe: Recipe) -> range:
    """Numbers of all shards."""
    return range(-(-len(recipe.plan) // shard_missions(len(recipe.plan))))


def shard_range(recipe: Recipe, number: int) -> range:
    """Missions of one shard."""
    size = shard_missions(len(recipe.plan))
    return range(number * size, min((number + 1) * size, len(recipe.plan)))


def open_target(recipe: Recipe, checkpoint: Checkpoint) -> ShardedStore:
    """The store that a run writes."""
    return ShardedStore(
        checkpoint.store,
        missions=len(recipe.plan),
        samples=recipe.plan.samples,
        staging=checkpoint.staging,
    )


def write_shard(
    recipe: Recipe, checkpoint: Checkpoint, target: ShardedStore, number: int
) -> list[FlownMission]:
    """Move the finished missions of a shard into the store's arrays.

    Raises:
      StoreError: a mission has disappeared.
    """
    missions = shard_range(recipe, number)
    kept: list[FlownMission] = []
    blocks: dict[str, NDArray[Any]] = {}
    positions = []
    for row, mission in enumerate(missions):
        found = checkpoint.read_mission(mission)
        if found is None:
            raise StoreError(
                f"mission {mission} has disappeared from {checkpoint.folder}; --resume flies it "
                "again"
            )
        flown, signals = found
        kept.append(flown)
        place = mission_place(flown.parameters, recipe.given_current)
        positions.append(mission_coordinates(signals, place))
        for name, values in signals.items():
            if name not in blocks:
                blocks[name] = np.full((len(missions), recipe.plan.samples), np.nan, DTYPE)
            blocks[name][row, : len(values)] = values
    for name in COORDINATES:
        blocks[name] = padded(name, [one[name] for one in positions], recipe.plan.samples)
    target.write_shard(number, blocks)
    checkpoint.finish_shard(number, kept)
    return kept


def small_arrays(recipe: Recipe, missions: Sequence[FlownMission]) -> dict[str, SmallArray]:
    """Coordinates, bookkeeping, drawn parameters and sensor constants."""
    plan = recipe.plan
    by_mission = (MISSION,)
    longest = max(len(flown.parameters.segments) for flown in missions)
    small = {
        MISSION: SmallArray(np.arange(len(plan)), by_mission, {"long_name": "mission index"}),
        TIME: SmallArray(
            np.arange(plan.samples) * SAMPLE_PERIOD,
            (TIME,),
            {"units": "s", "long_name": "time since the start of the mission"},
        ),
        SEGMENT: SmallArray(
            np.arange(longest), (SEGMENT,), {"long_name": "place of a segment in its mission"}
        ),
        names.N_SAMPLES: SmallArray(
            np.array([flown.samples for flown in missions], np.int32),
            by_mission,
            {
                "units": "1",
                "long_name": "number of samples of the mission",
                "comment": "later ones are padding",
            },
        ),
        names.DURATION: SmallArray(
            np.array(plan.durations_s), by_mission, {"units": "s", "long_name": "mission length"}
        ),
        names.SPLIT: SmallArray(
            np.array(plan.splits, np.int8),
            by_mission,
            {
                **flag_attributes("part of the data set", SPLITS),
                "comment": "missions are split, never samples",
            },
        ),
        names.ATTEMPT: SmallArray(
            np.array([flown.attempt for flown in missions], np.int16),
            by_mission,
            {"units": "1", "long_name": "number of attempts that failed before this one"},
        ),
    }
    places = [mission_place(flown.parameters, recipe.given_current) for flown in missions]
    for name, (_, values, said) in place_arrays(places).items():
        small[name] = SmallArray(values, by_mission, said)
    for name, parameter in recipe.table.items():
        array = _parameter_array(recipe, name, parameter, missions, longest)
        if array is not None:
            small[parameter.variable] = array
    for name, unit in recipe.suite.drawn_units().items():
        values = np.array([flown.sensors.get(name, 0.0) for flown in missions])
        if values.any():
            text = "constant of this mission's sensors: " + name.replace("_", " ")
            small[SENSOR_PREFIX + name] = SmallArray(
                values, by_mission, {"units": unit, "long_name": text}
            )
    return small


def _parameter_array(
    recipe: Recipe, name: str, parameter: Parameter, missions: Sequence[FlownMission], longest: int
) -> SmallArray | None:
    """One parameter of all missions; None when it is the same fixed value in all of them."""
    if name == "mission.duration_h":
        return None  # the array `duration` has it
    distribution = recipe.distributions[name]
    if parameter.per_segment:
        rows = [[segment[name] for segment in flown.parameters.segments] for flown in missions]
        used = any(value == value for row in rows for value in row)
    else:
        rows = [[flown.parameters.values[name]] for flown in missions]
        first = distribution.value if isinstance(distribution, Fixed) else None
        used = any(value == value and value != first for row in rows for value in row)
    if not used:
        return None
    attributes: dict[str, Any] = {
        "units": parameter.unit,
        "long_name": parameter.long_name,
        "distribution": distribution.text(),
        "parameter": name,
    }
    if parameter.why:
        attributes["comment"] = parameter.why
    meanings = option_names(recipe, name)
    if meanings:
        attributes = {**attributes, **flag_attributes(parameter.long_name, meanings)}
        del attributes["units"]
        filled = np.full((len(rows), longest), UNUSED_CODE, np.int8)
        for i, row in enumerate(rows):
            filled[i, : len(row)] = [_code(value, meanings) for value in row]
    else:
        filled = np.full((len(rows), longest), np.nan)
        for i, row in enumerate(rows):
            filled[i, : len(row)] = row
    if parameter.per_segment:
        return SmallArray(filled, (MISSION, SEGMENT), attributes)
    return SmallArray(filled[:, 0], (MISSION,), attributes)


def option_names(recipe: Recipe, name: str) -> tuple[str, ...]:
    """The words that a parameter can be; stores keep their positions."""
    if name == "mission.kind":
        return kinds_for(recipe.vehicle)
    distribution = recipe.distributions[name]
    if isinstance(distribution, Choice):
        return tuple(option for option in distribution.options if isinstance(option, str))
    return ()


def _code(value: Value, meanings: Sequence[str]) -> int:
    return meanings.index(value) if isinstance(value, str) else UNUSED_CODE


def store_attributes(
    recipe: Recipe, missions: Sequence[FlownMission], history: str
) -> dict[str, Any]:
    """The store's own attributes; all but `history` are the same for equal recipes."""
    failed = [
        {"mission": flown.mission, **_failure(failure)}
        for flown in missions
        for failure in flown.failures
    ]
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
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
        names.FAILED_MISSIONS: json.dumps(failed, allow_nan=False),
        names.HISTORY: f"{now}: {history}",
    }


def _failure(failure: FailedAttempt) -> dict[str, Any]:
    def plain(values: Mapping[str, Value]) -> dict[str, Value | None]:
        return {name: value if value == value else None for name, value in values.items()}

    return {
        "attempt": failure.attempt,
        "reason": failure.reason,
        "time_s": failure.time_s,
        "parameters": plain(failure.values),
        "segments": [plain(segment) for segment in failure.segments],
    }
