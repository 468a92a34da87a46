"""Sampling: the parameters of one mission, from the distributions and the mission's own seed.

Every parameter has its own random stream below (seed, mission, attempt), keyed by its name. So a
mission does not depend on the others or on who flies it, and a changed distribution leaves the
draws of all other parameters as they were.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from factory.sampling.distribution import Distribution, Drawn, Fixed, Value, number
from factory.sampling.mission_kind import MissionKind
from factory.sampling.parameters import Table
from factory.sampling.profiles import MISSION_KINDS, kinds_for
from factory.sampling.surveys import SURFACE, Streams
from twin.errors import InputError, MissionError, UnknownName, unknown_name
from twin.vehicle.vehicle import Vehicle

PLAN_STREAM, MISSION_STREAM = 0, 1
"""First element of every spawn key: what belongs to the whole run, and what to one mission."""
SENSOR_STREAM = 1
"""Below a mission's key: the sensors. Parameters use the checksum of their name, a larger one."""
MAX_SEGMENTS = 100
"""A mission of more segments means a wrong distribution of their length."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What one mission is made of; replays start from this alone."""

    duration_s: float
    """[s]"""
    values: Mapping[str, Value]
    """By name of the table: those drawn once per mission."""
    segments: tuple[Drawn, ...]
    """By name of the table: those drawn for each segment, NaN where a segment does not use one."""

    def number(self, name: str) -> float:
        """A value that must be a number; raises InputError for a word."""
        return number(self.values, name)

    @property
    def deepest_m(self) -> float:
        """Greatest depth that a segment is given [m]; 0 without one."""
        depths = (kind_of(segment).deepest_m(segment) for segment in self.segments)
        return max(depths, default=0.0)


def kind_of(segment: Drawn) -> MissionKind:
    """The kind of a drawn segment; raises UnknownName for a word that is none."""
    word = str(segment["mission.kind"])
    if word not in MISSION_KINDS:
        raise UnknownName("kind of mission", word, MISSION_KINDS)
    return MISSION_KINDS[word]


def sensor_seed(seed: int, mission: int, attempt: int) -> np.random.SeedSequence:
    """The root of its sensors."""
    key = (MISSION_STREAM, mission, attempt, SENSOR_STREAM)
    return np.random.SeedSequence(seed, spawn_key=key)


def draw_values(
    table: Table,
    distributions: Mapping[str, Distribution],
    *,
    seed: int,
    mission: int,
    attempt: int,
) -> dict[str, Value]:
    """The parameters that a mission draws once."""
    return {
        name: _stream(distributions[name], name, seed, mission, attempt)()
        for name, parameter in table.items()
        if not parameter.per_segment and name != "mission.duration_h"
    }


def draw_parameters(
    table: Table,
    distributions: Mapping[str, Distribution],
    *,
    seed: int,
    mission: int,
    attempt: int,
    duration_s: float,
    vehicle: Vehicle,
) -> Parameters:
    """The parameters of one attempt at one mission of `duration_s` seconds.

    Raises:
      MissionError: segments that cannot fill the mission, or that the vehicle cannot fly.
    """
    values = draw_values(table, distributions, seed=seed, mission=mission, attempt=attempt)
    streams = {
        name: _stream(distributions[name], name, seed, mission, attempt)
        for name, parameter in table.items()
        if parameter.per_segment
    }
    surface_every = values["mission.surface_every"]
    if isinstance(surface_every, str):
        raise InputError(f"mission.surface_every = {surface_every}: give a number or none")
    segments: list[Drawn] = []
    surfaces = not math.isnan(surface_every)
    if surfaces:
        segments.append(SURFACE.stay(streams))
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
    """Draws of one parameter."""
    if isinstance(distribution, Fixed):
        return lambda: distribution.value
    key = (MISSION_STREAM, mission, attempt, zlib.crc32(name.encode()))
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))
    return lambda: distribution.draw(rng)


def _draw(streams: Streams, vehicle: Vehicle) -> Drawn:
    """One segment that is not a stay at the surface.

    All parameters are drawn for every segment, so that no draw depends on the kinds before it.
    """
    drawn = {name: draw() for name, draw in streams.items()}
    word = str(drawn["mission.kind"])
    allowed = [name for name in kinds_for(vehicle) if name != SURFACE.name]
    if word not in allowed:
        what = unknown_name(f"kind of mission of vehicle {vehicle.name!r}", word, allowed)
        raise InputError(f"mission.kind = {word}: {what}")
    return MISSION_KINDS[word].keep(drawn)
