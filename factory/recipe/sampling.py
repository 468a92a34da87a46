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

from factory.recipe.distribution import Distribution, Fixed, Value
from factory.recipe.parameters import Table
from twin.errors import InputError, MissionError
from twin.mission.way import way
from twin.vehicle.vehicle import Vehicle

PLAN_STREAM, MISSION_STREAM = 0, 1
"""First element of every spawn key: what belongs to the whole run, and what to one mission."""
SENSOR_STREAM = 1
"""Below a mission's key: the sensors. Parameters use the checksum of their name, a larger one."""
MAX_SEGMENTS = 100
"""A mission of more segments means a wrong distribution of their length."""
TIME_RESERVE = 1.5
"""Segments without a clock are drawn until their steady ways take this many mission times."""
SAW_TOOTH, SPIRAL, SURFACE = "saw-tooth", "spiral", "surface"
KINDS = (SAW_TOOTH, SPIRAL, SURFACE)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What one mission is made of; replays start from this alone."""

    duration_s: float
    """[s]"""
    values: Mapping[str, Value]
    """By name of the table: those drawn once per mission."""
    segments: tuple[Mapping[str, Value], ...]
    """By name of the table: those drawn for each segment, NaN where a segment does not use one."""

    def number(self, name: str) -> float:
        """A value that must be a number; raises InputError for a word."""
        value = self.values[name]
        if isinstance(value, str):
            raise InputError(f"{name} = {value}: give numbers")
        return value

    @property
    def deepest_m(self) -> float:
        """Deepest turning depth of all segments [m]; 0 without one."""
        depths = [number(segment, "mission.max_depth_m") for segment in self.segments]
        return max((depth for depth in depths if not math.isnan(depth)), default=0.0)


def number(segment: Mapping[str, Value], name: str) -> float:
    """A segment's value that must be a number; raises InputError for a word."""
    value = segment[name]
    if isinstance(value, str):
        raise InputError(f"{name} = {value}: give numbers")
    return value


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
    segments: list[Mapping[str, Value]] = []
    surfaces = not math.isnan(surface_every)
    if surfaces:
        segments.append(_surfacing(streams))
    elapsed, dives = 0.0, 0
    while elapsed < duration_s:
        if len(segments) >= MAX_SEGMENTS:
            raise MissionError(
                f"more than {MAX_SEGMENTS} segments do not fill {duration_s:g} s: draw longer ones "
                "(mission.segment_duration_s, mission.yos)"
            )
        segment = _dive(streams)
        segments.append(segment)
        elapsed += _shortest_time(segment, vehicle)
        dives += 1
        if surfaces and dives % max(1, round(surface_every)) == 0:
            segments.append(_surfacing(streams))
            elapsed += number(segments[-1], "mission.surface_duration_s")
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


def _surfacing(streams: Mapping[str, Callable[[], Value]]) -> Mapping[str, Value]:
    segment: dict[str, Value] = dict.fromkeys(streams, math.nan)
    segment["mission.kind"] = SURFACE
    segment["mission.surface_duration_s"] = streams["mission.surface_duration_s"]()
    return segment


def _dive(streams: Mapping[str, Callable[[], Value]]) -> Mapping[str, Value]:
    segment = {name: draw() for name, draw in streams.items()}
    segment["mission.surface_duration_s"] = math.nan
    unused = {SAW_TOOTH: "mission.rotation_deg", SPIRAL: "mission.heading_change_deg"}
    kind = segment["mission.kind"]
    if kind not in unused:
        raise InputError(f"mission.kind = {kind}: choose among {SAW_TOOTH} and {SPIRAL}")
    if unused[str(kind)] in segment:
        segment[unused[str(kind)]] = math.nan
    return segment


def _shortest_time(segment: Mapping[str, Value], vehicle: Vehicle) -> float:
    """Time [s] that a segment lasts at least, up to TIME_RESERVE."""
    clock, yos = number(segment, "mission.segment_duration_s"), number(segment, "mission.yos")
    times = [] if math.isnan(clock) else [clock]
    if not math.isnan(yos):
        height = number(segment, "mission.max_depth_m") - number(segment, "mission.min_depth_m")
        slowness = 0.0
        speed = number(segment, "mission.speed_m_s") if "mission.speed_m_s" in segment else None
        for sign, pitch, mass in (
            (1.0, "pitch_deg", "mission.net_mass_kg"),
            (-1.0, "climb_pitch_deg", "mission.climb_net_mass_kg"),
        ):
            angle = -sign * number(segment, f"mission.{pitch}")
            heavy = sign * number(segment, mass) if mass in segment else 0.0
            kind = str(segment["mission.kind"])
            steady = way(vehicle, kind, pitch, angle, heavy, speed, within_travel=True)
            slowness += 1.0 / abs(steady.vertical_speed)
        times.append(yos * height * slowness / TIME_RESERVE)
    # a segment without limits is the last one
    return min(times, default=math.inf)
