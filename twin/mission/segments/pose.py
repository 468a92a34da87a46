"""Poses: segments of vehicles whose thrusters hold a pose: go to places, orbit, mow, by hand."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.errors import MissionError
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import Segment, blank_row, limit
from twin.mission.segments.level import MOST_LEGS, SHALLOWEST_M, check_place
from twin.mission.stationing import DEPTH_RATE
from twin.mission.way import TIME_MARGIN, check_near, heading
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle

METRES = ("north_m", "east_m")
"""Keys of a target: metres from the start."""
STEP_DEG = 5.0
"""[degree] Largest angle of an orbit between two of its targets."""
SETTLING = 15.0
"""[s] Expected time until a vehicle has come to rest at a target."""


def pose_row(vehicle: Vehicle, label: str, kind: float = g.POSE) -> Array:
    """Row that holds the pose at which it begins.

    Raises:
      MissionError: the vehicle has no thrusters that hold a pose, or no gains for them.
    """
    if not vehicle.holds_pose:
        lacks = "<numeric name='station_pid'>" if vehicle.station_pid is None else "thrusters"
        raise MissionError(
            f"{label}: the file of vehicle {vehicle.name!r} has no {lacks}: nothing holds a pose; "
            "fly it with vehicle bluerov2, or give another segment"
        )
    row = blank_row(vehicle)
    row[g.KIND], row[g.SEES_TRUTH] = kind, 1.0
    row[g.LEVEL_SPEED] = vehicle.cruise_speed
    row[g.STAY] = 0.0
    row[[g.STICK_SURGE, g.STICK_SWAY, g.STICK_HEAVE]] = 0.0
    return row


@dataclass(frozen=True, kw_only=True)
class Posed(Segment):
    """Base of segments at a depth or above the sea floor, with thrusters."""

    depth_m: float | None = None
    """Depth to keep [m]; None: that at the segment's start, unless `altitude_m` is given."""
    altitude_m: float | None = None
    """Height above the sea floor to keep [m]; needs a sea floor."""
    min_depth_m: float = SHALLOWEST_M
    """Least depth [m] at an altitude."""
    speed_m_s: float | None = None
    """Speed over ground on the way [m/s]; None: the vehicle's cruising speed."""

    def __post_init__(self) -> None:
        if self.depth_m is not None or self.altitude_m is not None:
            check_place(self.kind, self.depth_m, self.altitude_m)
        check.within(self.kind, "min_depth_m", self.min_depth_m, "m", 0.0)
        check.fields(self, self.kind, "stay_s")  # 0 is allowed here

    def posed_row(self, vehicle: Vehicle, label: str) -> Array:
        """Row at this segment's depth and speed; raises MissionError without thrusters."""
        row = pose_row(vehicle, label)
        row[g.DEPTH], row[g.ALTITUDE] = limit(self.depth_m), limit(self.altitude_m)
        row[g.MIN_DEPTH] = self.min_depth_m
        if self.speed_m_s is not None:
            row[g.LEVEL_SPEED] = self.speed_m_s
        return row

    def whole(self) -> Pose:
        """One pose with the targets of the whole segment, which ends where they do."""
        raise NotImplementedError

    def through(self, targets: list[dict[str, float]], heading_deg: float | None = None) -> Pose:
        """Pose with these targets at this segment's depth and speed."""
        common = {field.name: getattr(self, field.name) for field in dataclasses.fields(Posed)}
        return Pose(targets=tuple(targets), heading_deg=heading_deg, **common)

    def flown_as(self) -> tuple[Segment, ...]:
        """Poses with one target each."""
        return self.whole().flown_as()

    def begun_at(self, place: tuple[float, float]) -> Segment:
        """Pose with the start, north and east [m], as a target before the first."""
        return self.whole().begun_at(place)

    def ends_at(self, place: tuple[float, float]) -> tuple[float, float]:
        """Last target, north and east [m]."""
        return self.whole().ends_at(place)

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Time [s] and depth [m] of the poses."""
        return self.whole().expected(vehicle, depth, label)


@dataclass(frozen=True, kw_only=True)
class Pose(Posed):
    """Go to one place after another at a heading, on straight lines, and stay there.

    Guidance counts every target as a segment of its own. It takes the true position, as from
    acoustics, or a navigator's.
    """

    kind = "pose"
    limits = ("targets", "duration_s")

    targets: tuple[Mapping[str, float], ...] | None = None
    """Targets in order, `{ north_m = 5, east_m = 0 }` from the start; a `heading_deg` beside them
    turns the vehicle there. None: the place where it is."""
    heading_deg: float | None = None
    """Heading to hold [deg true]; None: the heading at the segment's start."""
    stay_s: float = 0.0
    """Time at each target [s]; 0: the next one follows without a stop."""
    arrival_radius_m: float = 0.5
    """Distance [m] from a target at which the stay begins."""
    duration_s: float | None = None
    """Limit: time [s], for each target."""

    def __post_init__(self) -> None:
        check.within(self.kind, "stay_s", self.stay_s, "s", 0.0)
        super().__post_init__()
        if self.targets is None:
            return
        if not isinstance(self.targets, list | tuple) or not self.targets:
            check.fail(self.kind, "targets", self.targets, "a list of at least one target")
        for number, target in enumerate(self.targets):
            label = f"{self.kind}: targets[{number}]"
            if not isinstance(target, Mapping) or set(target) - {"heading_deg"} != set(METRES):
                raise MissionError(
                    f"{label} is {target!r}: give {{ north_m = METRES, east_m = METRES }}, and "
                    "heading_deg if the vehicle turns there"
                )
            numbers = {key: check.number(label, key, value) for key, value in target.items()}
            check_near(label, numbers["north_m"], numbers["east_m"])
        object.__setattr__(self, "targets", tuple(self.targets))

    def flown_as(self) -> tuple[Pose, ...]:
        """Poses with one target each."""
        if self.targets is None:
            return (self,)
        return tuple(dataclasses.replace(self, targets=(target,)) for target in self.targets)

    def begun_at(self, place: tuple[float, float]) -> Pose:
        """Copy of the segment with its start, north and east [m], as a target before the first."""
        first = dict(zip(METRES, place, strict=True))
        return dataclasses.replace(self, targets=(first, *(self.targets or (first,))))

    def ends_at(self, place: tuple[float, float]) -> tuple[float, float]:
        """Last target, north and east [m], or else `place`."""
        last = (self.targets or (dict(zip(METRES, place, strict=True)),))[-1]
        return last["north_m"], last["east_m"]

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Row to the first target."""
        row = self.posed_row(vehicle, label)
        target: Mapping[str, float] = (self.targets or ({},))[0]
        row[g.TARGET_NORTH], row[g.TARGET_EAST] = (target.get(k, np.nan) for k in METRES)
        row[g.HEADING] = heading(target.get("heading_deg", self.heading_deg))
        row[g.STAY], row[g.ARRIVAL_RADIUS] = self.stay_s, self.arrival_radius_m
        row[g.DURATION] = limit(self.duration_s)
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Time [s] of the way and the stays, or of the limit; and the depth [m] at its end."""
        speed = self.speed_m_s or self.posed_row(vehicle, label)[g.LEVEL_SPEED]
        after = depth if self.depth_m is None else self.depth_m
        places = [(t["north_m"], t["east_m"]) for t in self.targets or ()]
        legs = max(len(places) - 1, 1)
        metres = sum(math.dist(a, b) for a, b in itertools.pairwise(places))
        stops = legs if self.stay_s else 1
        time = TIME_MARGIN * (metres / speed + stops * (self.stay_s + SETTLING))
        time += TIME_MARGIN * abs(after - depth) / DEPTH_RATE
        return (time if self.duration_s is None else legs * self.duration_s), after


@dataclass(frozen=True, kw_only=True)
class Orbit(Posed):
    """Circle about a point at a constant heading, with surge and sway, or facing the point."""

    kind = "orbit"

    north_m: float
    """Centre [m] north of the start."""
    east_m: float
    """Centre [m] east of the start."""
    radius_m: float
    """Radius over ground [m], positive clockwise as seen from above."""
    turns: float = 1.0
    """Number of circles."""
    heading_deg: float | None = None
    """Heading to hold [deg true]; None: towards the centre."""
    from_deg: float = 180.0
    """Bearing from the centre at which the circle begins and ends [deg true]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(check.number(self.kind, "radius_m", self.radius_m)) > 0.0:
            check.fail(self.kind, "radius_m", self.radius_m, "a radius, positive clockwise")
        check.within(self.kind, "turns", self.turns, "", 0.0, MOST_LEGS * STEP_DEG / 360.0)

    def whole(self) -> Pose:
        """One pose with a target every STEP_DEG of the circle."""
        count = max(math.ceil(360.0 * self.turns / STEP_DEG), 1)
        turned = math.copysign(360.0 * self.turns, self.radius_m)
        targets = []
        for k in range(count + 1):
            bearing = self.from_deg + turned * k / count
            north = self.north_m + abs(self.radius_m) * math.cos(math.radians(bearing))
            east = self.east_m + abs(self.radius_m) * math.sin(math.radians(bearing))
            faced = (bearing + 180.0) % 360.0 if self.heading_deg is None else self.heading_deg
            targets.append({"north_m": north, "east_m": east, "heading_deg": faced})
        return self.through(targets)


@dataclass(frozen=True, kw_only=True)
class Mow(Posed):
    """Lawn mower at a constant heading: parallel legs back and forth, joined by sway."""

    kind = "mow"

    heading_deg: float
    """Heading that the vehicle holds, and direction of the first leg [deg true]."""
    leg_length_m: float
    """Length of a leg over ground [m]."""
    spacing_m: float
    """Distance between legs [m], positive to starboard."""
    legs: float
    """Number of legs, which begin at the start of the mission."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(check.number(self.kind, "spacing_m", self.spacing_m)) > 0.0:
            check.fail(self.kind, "spacing_m", self.spacing_m, "a distance, positive to starboard")
        check.within(self.kind, "legs", self.legs, "", 1, MOST_LEGS)
        if self.legs % 1:
            check.fail(self.kind, "legs", self.legs, "a whole number")

    def whole(self) -> Pose:
        """One pose with the ends of the legs as targets."""
        c, s = math.cos(math.radians(self.heading_deg)), math.sin(math.radians(self.heading_deg))
        targets = []
        for leg in range(int(self.legs)):
            ends = (0.0, self.leg_length_m)
            for ahead in ends if leg % 2 == 0 else ends[::-1]:
                aside = leg * self.spacing_m
                north, east = c * ahead - s * aside, s * ahead + c * aside
                targets.append({"north_m": north, "east_m": east})
        return self.through(targets, self.heading_deg)


@dataclass(frozen=True, kw_only=True)
class Sticks(Segment):
    """Fly by hand: forces in body axes and a turn, with depth hold and heading hold.

    The depth is held while `heave` is 0, and the heading turns at `yaw_deg_s`. No position is used.
    """

    kind = "sticks"
    limits = ("duration_s",)

    surge: float = 0.0
    """Share of the largest force ahead, -1 to 1."""
    sway: float = 0.0
    """Share of the largest force to starboard, -1 to 1."""
    heave: float = 0.0
    """Share of the largest force down, -1 to 1; 0: the depth is held."""
    yaw_deg_s: float = 0.0
    """Rate at which the held heading turns [deg/s], positive to starboard."""
    duration_s: float | None = None
    """Limit: time [s]."""

    def __post_init__(self) -> None:
        for name in ("surge", "sway", "heave"):
            check.within(self.kind, name, getattr(self, name), "", -1.0, 1.0)
        check.within(self.kind, "yaw_deg_s", self.yaw_deg_s, "deg/s", -90.0, 90.0)
        check.fields(self, self.kind)

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Row with the sticks' positions."""
        row = pose_row(vehicle, label, g.STICKS)
        row[g.STICK_SURGE], row[g.STICK_SWAY] = self.surge, self.sway
        row[g.STICK_HEAVE], row[g.TURN_RATE] = self.heave, math.radians(self.yaw_deg_s)
        row[g.DURATION] = limit(self.duration_s)
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Time `duration_s` [s] and the same depth [m]; a heave moves it by an unknown amount."""
        assert self.duration_s is not None
        return self.duration_s, depth
