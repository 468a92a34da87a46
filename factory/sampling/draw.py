"""Draw: sample the plan of a store, and the parameters of one mission from its own seed.

The plan has the duration and the split of each mission, before any mission flies. Every parameter
has its own random stream, keyed by (seed, mission, attempt) and its name. So a mission depends
neither on other missions nor on the worker, and a changed distribution leaves the values of all
other parameters unchanged.
"""

from __future__ import annotations

import math
import shutil
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from factory.sampling.distribution import Distribution, Drawn, Fixed, Value, number
from factory.sampling.mission_kinds import MISSION_KINDS, SURFACE, MissionKind, Streams, kinds_for
from twin.errors import InputError, MissionError, UnknownName, unknown_name
from twin.physics.true_signals import SAMPLE_PERIOD
from twin.records.attributes import SPLITS

if TYPE_CHECKING:
    from factory.sampling.parameters import Table
    from twin.vehicle.vehicle import Vehicle

TRAIN, VALIDATION, TEST = 0, 1, 2
VALIDATION_SHARE, TEST_SHARE = 0.15, 0.15
"""[1] Fractions of the missions (training 70 %, as in the paper, which splits samples instead)"""
MIN_MISSIONS = len(SPLITS)
"""Minimum number of missions in a store: one for each split"""
MIN_DURATION_S = 60.0
"""[s] Shortest mission; within this time a mission is still launching."""
HOUR = 3600.0
BYTES_PER_HOUR = 0.4e6
"""[byte/h] Approximate size of a store: preset paper takes 0.36 MB, field 0.49; short ones more"""
GIGABYTE = 1e9
MOST_HOURS = 1e7
"""[h] Longest store; to plan more missions would take minutes before the first one flies."""
MAX_SEGMENTS = 100
"""Maximum number of segments in a mission; more mean a wrong distribution of their duration."""
PLAN_STREAM, MISSION_STREAM = 0, 1
"""First element of spawn keys, for random numbers of the plan, or of a mission (MISSION_STREAM)"""
_DURATION_STREAM, _SPLIT_STREAM = 0, 1
SENSOR_STREAM = 1
"""Key of the sensors below a mission's key; a parameter's key is its name's checksum, above 1."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Durations and splits of all missions of one store."""

    durations_s: tuple[float, ...]
    """[s] Duration of each mission, a multiple of the sample period"""
    splits: tuple[int, ...]
    """TRAIN, VALIDATION or TEST for each mission"""

    def __len__(self) -> int:
        return len(self.durations_s)

    @property
    def hours(self) -> float:
        """[h] Time of all missions together."""
        return sum(self.durations_s) / HOUR

    @property
    def samples(self) -> int:
        """Number of samples of the longest mission."""
        return samples_in(max(self.durations_s))


def samples_in(duration_s: float) -> int:
    """Count the samples of a mission, both ends included."""
    return round(duration_s / SAMPLE_PERIOD) + 1


def check_hours(hours: float) -> None:
    """Raise InputError unless `hours` [h] is a positive number that can be planned."""
    if np.isnan(hours):
        raise InputError("--hours nan is not a number; give hours, such as 10")
    if not hours > 0.0:
        raise InputError(f"--hours {hours:g} must be above 0")
    if hours > MOST_HOURS:
        raise InputError(
            f"--hours {hours:g} would need about {_size(hours)}; give at most {MOST_HOURS:g}, and "
            "more as several stores of different --seed"
        )


def check_room(hours: float, store: Path) -> None:
    """Raise InputError if the disk of `store` has no room for missions of `hours` [h]."""
    check_hours(hours)
    folder = next(p for p in (store.absolute(), *store.absolute().parents) if p.is_dir())
    free = shutil.disk_usage(folder).free
    if hours * BYTES_PER_HOUR > free:
        raise InputError(
            f"--hours {hours:g} needs about {_size(hours)}, and {folder} has {free / GIGABYTE:.3g} "
            "GB free: give fewer hours or an --out on another disk"
        )


def _size(hours: float) -> str:
    return f"{hours * BYTES_PER_HOUR / GIGABYTE:.3g} GB"


def plan_missions(duration_h: Distribution, *, hours: float, seed: int) -> Plan:
    """Sample durations of missions that add up to `hours` [h]; the last ones are cut to fit.

    Raises:
      InputError: `hours` is not positive, or too short for three missions.
    """
    check_hours(hours)
    total = round(hours * HOUR / SAMPLE_PERIOD)
    if total * SAMPLE_PERIOD < MIN_MISSIONS * MIN_DURATION_S:
        raise InputError(
            f"--hours {hours:g} is too little: each of the splits {', '.join(SPLITS)} needs a "
            f"mission of {MIN_DURATION_S:g} s, so give at least "
            f"{MIN_MISSIONS * MIN_DURATION_S / HOUR:g}"
        )
    rng = _generator(seed, PLAN_STREAM, _DURATION_STREAM)
    durations: list[int] = []
    remaining = total
    while remaining > 0:
        drawn = duration_h.draw(rng)
        if isinstance(drawn, str) or not drawn * HOUR >= MIN_DURATION_S:
            raise InputError(
                f"mission.duration_h = {duration_h.text()} gives {drawn}: draw hours, at least "
                f"{MIN_DURATION_S / HOUR:g}"
            )
        durations.append(round(drawn * HOUR / SAMPLE_PERIOD))
        remaining -= durations[-1]
    durations[-1] += remaining
    _settle_last(durations, duration_h)
    if len(durations) < MIN_MISSIONS:
        durations = _equal_parts(total, MIN_MISSIONS)
    times = tuple(samples * SAMPLE_PERIOD for samples in durations)
    validation, test = (max(1, round(s * len(times))) for s in (VALIDATION_SHARE, TEST_SHARE))
    splits = np.full(len(times), TRAIN)  # each split gets at least one mission
    splits[:validation] = VALIDATION
    splits[validation : validation + test] = TEST
    drawn_splits = _generator(seed, PLAN_STREAM, _SPLIT_STREAM).permutation(splits)
    return Plan(durations_s=times, splits=tuple(drawn_splits.tolist()))


def _settle_last(durations: list[int], duration_h: Distribution) -> None:
    """Join a last mission that is too short with the one before, or share the time equally."""

    def allowed(samples: int) -> bool:
        return duration_h.allows(samples * SAMPLE_PERIOD / HOUR)

    if len(durations) < 2 or allowed(durations[-1]):
        return
    both = durations[-2] + durations[-1]
    durations[-2:] = [both] if allowed(both) else _equal_parts(both, 2)


def _equal_parts(total: int, parts: int) -> list[int]:
    return [total // parts + (i < total % parts) for i in range(parts)]


def _generator(seed: int, *key: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Sampled parameters of one mission; a replay needs nothing else."""

    duration_s: float
    """[s] Duration of the mission"""
    values: Mapping[str, Value]
    """Parameters that are sampled once per mission, by name in the table"""
    segments: tuple[Drawn, ...]
    """Parameters of each segment, by name in the table; NaN if a segment does not use one"""

    def number(self, name: str) -> float:
        """Return a parameter that must be a number; raises InputError for a word."""
        return number(self.values, name)

    @property
    def deepest_m(self) -> float:
        """[m] Deepest turning depth or depth of any segment; 0 without one."""
        depths = (kind_of(segment).deepest_m(segment) for segment in self.segments)
        return max(depths, default=0.0)


def kind_of(segment: Drawn) -> MissionKind:
    """Return the type of a sampled segment; raises UnknownName for an unknown word."""
    word = str(segment["mission.kind"])
    if word not in MISSION_KINDS:
        raise UnknownName("kind of mission", word, MISSION_KINDS)
    return MISSION_KINDS[word]


def sensor_seed(seed: int, mission: int, attempt: int) -> np.random.SeedSequence:
    """Return the seed for the sensors of one attempt at a mission."""
    key = (MISSION_STREAM, mission, attempt, SENSOR_STREAM)
    return np.random.SeedSequence(seed, spawn_key=key)


def draw_values(
    table: Table, distributions: Mapping[str, Distribution], **key: int
) -> dict[str, Value]:
    """Sample the parameters that a mission has once.

    Args:
      key: `seed`, `mission` and `attempt`.
    """
    return {
        name: _stream(distributions[name], name, **key)()
        for name, parameter in table.items()
        if not parameter.per_segment and name != "mission.duration_h"
    }


def draw_parameters(
    table: Table,
    distributions: Mapping[str, Distribution],
    *,
    duration_s: float,
    vehicle: Vehicle,
    **key: int,
) -> Parameters:
    """Sample the parameters of one attempt at a mission of `duration_s` [s].

    Args:
      key: `seed`, `mission` and `attempt`.

    Raises:
      MissionError: segments that cannot fill the mission, or that the vehicle cannot fly.
    """
    values = draw_values(table, distributions, **key)
    streams = {
        name: _stream(distributions[name], name, **key)
        for name, parameter in table.items()
        if parameter.per_segment
    }
    surface_every = values["mission.surface_every"]
    if isinstance(surface_every, str):
        raise InputError(f"mission.surface_every = {surface_every}: give a number or none")
    surfaces = not math.isnan(surface_every)
    segments: list[Drawn] = [SURFACE.stay(streams)] if surfaces else []
    elapsed, dives = 0.0, 0
    while elapsed < duration_s:
        if len(segments) >= MAX_SEGMENTS:
            raise MissionError(
                f"more than {MAX_SEGMENTS} segments do not fill {duration_s:g} s: draw longer ones "
                "(mission.segment_duration_s, mission.yos)"
            )
        segment = _draw(streams, vehicle)
        segments.append(segment)
        elapsed += kind_of(segment).shortest_time(segment, vehicle)
        dives += 1
        if surfaces and dives % max(1, round(surface_every)) == 0:
            segments.append(SURFACE.stay(streams))
            elapsed += SURFACE.shortest_time(segments[-1], vehicle)
    return Parameters(duration_s=duration_s, values=values, segments=tuple(segments))


def _stream(
    distribution: Distribution, name: str, seed: int, mission: int, attempt: int
) -> Callable[[], Value]:
    """Function that samples one parameter from its own random stream."""
    if isinstance(distribution, Fixed):
        return lambda: distribution.value
    rng = _generator(seed, MISSION_STREAM, mission, attempt, zlib.crc32(name.encode()))
    return lambda: distribution.draw(rng)


def _draw(streams: Streams, vehicle: Vehicle) -> Drawn:
    """Sample one segment that is not a surface interval.

    Every segment samples all parameters, so that no value depends on the types of segments before.
    """
    drawn = {name: draw() for name, draw in streams.items()}
    word = str(drawn["mission.kind"])
    allowed = [name for name in kinds_for(vehicle) if name != SURFACE.name]
    if word not in allowed:
        what = unknown_name(f"kind of mission of vehicle {vehicle.name!r}", word, allowed)
        raise InputError(f"mission.kind = {word}: {what}")
    return MISSION_KINDS[word].keep(drawn)
