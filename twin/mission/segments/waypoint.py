"""Waypoint: dives and climbs toward targets, as gliders fly them from fix to fix."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin import geodesy
from twin.errors import MissionError, unknown_name
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import command_of, limit
from twin.mission.segments.profile import Profile
from twin.mission.segments.station import Surface
from twin.mission.way import Way, check_near, check_reachable, turn_limit
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle

DEGREES, METRES = ("latitude", "longitude"), ("north_m", "east_m")
"""Keys of a target. DEGREES: geographic. METRES: from the origin of the mission's frame."""
RENEWALS = ("at-surfacing", "continuously")
POSITIONS = ("dead-reckoned", "true")
CURRENTS = ("estimated", "none")
HIGHEST_LATITUDE = 88.0
"""[degree] Limit of latitude, as for a start; nearer to a pole, north and east have no meaning."""
LEG_MARGIN = 2.0
"""[1] Factor on the time of a leg in still water: allows for a current of half the speed."""


@dataclass(frozen=True, kw_only=True)
class Waypoint(Profile):
    """Yos toward one target after another; at the surface a fix updates position and course.

    Guidance counts every target as a segment of its own; limits hold for each.
    """

    kind = "waypoint"
    limits = ()  # it ends on arrival

    targets: tuple[Mapping[str, float], ...]
    """Targets in order: `{ latitude = 49.1, longitude = -16.2 }` [degree], or
    `{ north_m = 2000, east_m = -500 }` from the start."""
    arrival_radius_m: float = 100.0
    """Distance [m] from the target, in the estimated position, at which the target is reached."""
    surface_after_s: float | None = None
    """Time under water [s] after which the vehicle surfaces, wherever it is; None: no such time."""
    surface_after_yos: float | None = None
    """Number of yos after which the vehicle surfaces; None: no such number."""
    surface_at_target: bool = True
    """True: the vehicle surfaces when it has reached a target."""
    stay_s: float = 300.0
    """Time at the surface [s] for a fix."""
    renewed: str = "at-surfacing"
    """Time at which the course is updated: "at-surfacing", or "continuously" under water."""
    position: str = "dead-reckoned"
    """Position that guidance uses under water: "dead-reckoned" since the last fix from vertical
    velocity, pitch and compass; or the "true" one."""
    current: str = "estimated"
    """Current that dead reckoning and course allow for: "estimated", from the misclosure at the
    last surfacing; or "none"."""
    current_north_m_s: float | None = None
    """Current northward [m/s] before the first estimate; give `current_east_m_s` as well."""
    current_east_m_s: float | None = None
    """Current eastward [m/s] before the first estimate."""
    max_rotation_deg: float = 45.0
    """Limit of the turning part in the heading loop [deg], as in a saw-tooth."""

    def __post_init__(self) -> None:
        super().__post_init__()
        kind = self.kind
        if not isinstance(self.targets, list | tuple) or not self.targets:
            check.fail(kind, "targets", self.targets, "a list of at least one target")
        targets = tuple(_target(f"{kind}: targets[{i}]", t) for i, t in enumerate(self.targets))
        object.__setattr__(self, "targets", targets)
        if self.surface_after_yos is not None and self.surface_after_yos % 1:
            check.fail(kind, "surface_after_yos", self.surface_after_yos, "a whole number")
        if not isinstance(self.surface_at_target, bool):
            check.fail(kind, "surface_at_target", self.surface_at_target, "true or false")
        for field, allowed in (
            ("renewed", RENEWALS), ("position", POSITIONS), ("current", CURRENTS),
        ):  # fmt: skip
            value = getattr(self, field)
            if value not in allowed:
                raise MissionError(f"{kind}: {unknown_name(field, str(value), allowed)}")
        if (self.current_north_m_s is None) != (self.current_east_m_s is None):
            raise MissionError(f"{kind}: give current_north_m_s and current_east_m_s together")
        if self.current_north_m_s is not None and self.current == "none":
            raise MissionError(
                f'{kind}: current_north_m_s beside current = "none" would be ignored: leave one out'
            )

    @property
    def geographic(self) -> bool:
        """True if some target is a latitude and longitude."""
        return any("latitude" in target for target in self.targets)

    def placed(self, latitude: float, longitude: float) -> Waypoint:
        """Copy of the segment with all targets in metres from an origin [degree].

        Raises:
          MissionError: a target is more than 1000 km away.
        """
        for number, target in enumerate(self.targets, start=1):
            if "latitude" in target:
                place = target["latitude"], target["longitude"]
                check_reachable(f"{self.kind}: target {number}", place, (latitude, longitude))
        return dataclasses.replace(
            self, targets=tuple(_in_metres(target, latitude, longitude) for target in self.targets)
        )

    def begun_at(self, place: tuple[float, float]) -> Waypoint:
        """Copy of the segment with its start, north and east [m], as a target before the first."""
        first = dict(zip(METRES, place, strict=True))
        return dataclasses.replace(self, targets=(first, *self.targets))

    def ends_at(self, place: tuple[float, float]) -> tuple[float, float]:
        """Last target, north and east [m]."""
        last = self.targets[-1]
        return last["north_m"], last["east_m"]

    def flown_as(self) -> tuple[Waypoint, ...]:
        """Segments with one target each."""
        return tuple(dataclasses.replace(self, targets=(target,)) for target in self.targets)

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Row of a profile to the first target; without a position while the target is in degrees.

        Raises:
          MissionError: as for every profile; or no part turns the vehicle.
        """
        if vehicle.steered("heading") is None:
            raise MissionError(
                f"{label}: vehicle {vehicle.name!r} has no part that turns it: it goes nowhere"
            )
        row = super().row(vehicle, label)
        row[g.KIND] = g.WAYPOINT
        row[g.TURN_LIMIT] = turn_limit(vehicle, self.max_rotation_deg)
        target = self.targets[0]
        row[g.TARGET_NORTH] = target.get("north_m", np.nan)
        row[g.TARGET_EAST] = target.get("east_m", np.nan)
        row[g.ARRIVAL_RADIUS] = self.arrival_radius_m
        row[g.YO_SPEED] = _yo_speed(*self._ways(vehicle, label))
        row[g.SURFACE_AFTER], row[g.STAY] = limit(self.surface_after_s), self.stay_s
        row[g.SURFACE_YOS] = limit(self.surface_after_yos)
        row[g.SURFACE_AT_TARGET] = float(self.surface_at_target)
        row[g.STEERS_ALWAYS] = float(self.renewed == "continuously")
        row[g.SEES_TRUTH] = float(self.position == "true")
        row[g.USES_CURRENT] = float(self.current == "estimated")
        row[g.FIRST_CURRENT_NORTH] = limit(self.current_north_m_s)
        row[g.FIRST_CURRENT_EAST] = limit(self.current_east_m_s)
        pitch = self.pitch_deg if self.climb_pitch_deg is None else self.climb_pitch_deg
        afloat = Surface(pitch_deg=pitch).row(vehicle, label)
        rest = command_of(vehicle, row, g.REST_COMMAND)
        rest[:] = command_of(vehicle, afloat, g.REST_COMMAND)
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Time [s] from target to target at the yos' speed with a margin, plus surface intervals;
        the segment's own limits shorten it. Also the largest depth [m]."""
        ways = self._ways(vehicle, label)
        legs = max(len(self.targets) - 1, 1)
        points = [(t["north_m"], t["east_m"]) for t in self.targets]
        metres = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
        time = LEG_MARGIN * metres / _yo_speed(*ways)
        down_and_up = (self.max_depth_m + depth) * (
            1.0 / ways[0].vertical_speed - 1.0 / ways[1].vertical_speed
        )
        under = [math.inf if self.surface_after_s is None else self.surface_after_s]
        if self.surface_after_yos is not None:
            under.append(self.surface_after_yos * down_and_up)
        # at least one dive and one surface interval for every target, however near
        stays = legs + math.ceil(time / min(under)) if math.isfinite(min(under)) else legs
        total = time + stays * (self.stay_s + down_and_up)
        if self.yos is not None or self.duration_s is not None or self.until_depth_m is not None:
            limited, _ = super().expected(vehicle, depth, label)
            total = min(total, legs * (limited + self.stay_s + down_and_up))
        return total, self.max_depth_m


def _yo_speed(dive: Way, climb: Way) -> float:
    """Mean horizontal speed [m/s] through the water of a dive and its climb."""
    ahead, time = 0.0, 0.0
    for one in (dive, climb):
        share = 1.0 / abs(one.vertical_speed)
        ahead += share * math.sqrt(max(one.speed**2 - one.vertical_speed**2, 0.0))
        time += share
    return ahead / time


def _target(label: str, target: object) -> dict[str, float]:
    """Convert a target to numbers; raises MissionError for anything else."""
    if not isinstance(target, Mapping):
        raise MissionError(
            f"{label} is {target!r}: give {{ latitude = DEGREES, longitude = DEGREES }} or "
            "{ north_m = METRES, east_m = METRES }"
        )
    for key in target:
        if key not in (*DEGREES, *METRES):
            raise MissionError(f"{label}: {unknown_name('key', str(key), (*DEGREES, *METRES))}")
    if set(target) not in (set(DEGREES), set(METRES)):
        raise MissionError(
            f"{label} has {', '.join(target) or 'nothing'}: give latitude and longitude, or "
            "north_m and east_m"
        )
    if "latitude" in target:
        highest = HIGHEST_LATITUDE
        check.within(label, "latitude", target["latitude"], "degree", -highest, highest)
        check.within(label, "longitude", target["longitude"], "degree", -360.0, 360.0)
    numbers = {key: check.number(label, key, value) for key, value in target.items()}
    if "north_m" in numbers:
        check_near(label, numbers["north_m"], numbers["east_m"])
    return numbers


def _in_metres(target: Mapping[str, Any], latitude: float, longitude: float) -> dict[str, float]:
    if "latitude" not in target:
        return dict(target)
    place = geodesy.to_tangent_plane(target["latitude"], target["longitude"], latitude, longitude)
    return dict(zip(METRES, place, strict=True))
