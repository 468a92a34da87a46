"""Level legs at a depth or above the sea floor: transect, circle and lawn-mower."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from twin.errors import MissionError
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import Segment, blank_row, command_of, limit, write_way
from twin.mission.turning import circling, turn_factor
from twin.mission.way import Way, heading, level_way, reject_missing, turn_limit
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle

MAX_PITCH_DEG = 20.0
"""[degree] Default limit of pitch while the depth loop changes depth, as in the LRAUV's yo-yos."""
SHALLOWEST_M = 2.0
"""[m] Default least depth of a leg at an altitude, so that the propeller stays under water."""
MOST_TRIES = 300
"""Number of circles, each 2 % wider, among which the error finds the smallest possible one."""
MOST_LEGS = 10_000
"""Largest number of legs in a survey; each leg is a row of guidance's table."""


def check_place(kind: str, depth_m: float | None, altitude_m: float | None) -> None:
    """Raise MissionError unless exactly one of depth and altitude is given, and above zero."""
    if (depth_m is None) == (altitude_m is None):
        raise MissionError(
            f"{kind}: give either depth_m or altitude_m (above the sea floor), "
            f"{'not both' if depth_m is not None else 'one of them is needed'}"
        )
    field, value = ("depth_m", depth_m) if depth_m is not None else ("altitude_m", altitude_m)
    check.limit(kind, field, value, "m")


@dataclass(frozen=True, kw_only=True)
class Level(Segment):
    """Level leg at a depth or altitude under a propeller; base of `Transect` and `Circle`."""

    depth_m: float | None = None
    """Depth to keep [m]; give this or `altitude_m`."""
    altitude_m: float | None = None
    """Height above the sea floor to keep [m]; needs a sea floor."""
    min_altitude_m: float | None = None
    """The vehicle rises above its depth if the sea floor comes nearer than this [m]; None: it never
    does."""
    min_depth_m: float = SHALLOWEST_M
    """Smallest depth [m] of a leg at an altitude."""
    speed_m_s: float | None = None
    """Speed through the water [m/s]; None: the vehicle's cruising speed."""
    max_pitch_deg: float = MAX_PITCH_DEG
    """Largest pitch, up or down, that the depth loop commands [deg]."""
    max_rotation_deg: float = 45.0
    """Limit of the rudder in the heading loop [deg], within the rudder's travel."""

    def __post_init__(self) -> None:
        check_place(self.kind, self.depth_m, self.altitude_m)
        check.within(self.kind, "min_depth_m", self.min_depth_m, "m", 0.0)
        check.fields(self, self.kind)

    def way(self, vehicle: Vehicle, label: str) -> Way:
        """Steady level motion on this leg; raises MissionError if the vehicle cannot fly it."""
        reject_missing(vehicle, label, self)
        steady = level_way(vehicle, label, self.speed_m_s)
        if vehicle.steered("pitch") is None or vehicle.depth_pid is None:
            what = (
                "no part that pitches it" if vehicle.depth_pid else "no <numeric name='depth_pid'>"
            )
            raise MissionError(
                f"{label}: the file of vehicle {vehicle.name!r} has {what}: nothing holds a depth"
            )
        return steady

    def level_row(self, vehicle: Vehicle, label: str) -> tuple[Array, Way]:
        """Row that keeps the depth until its limit, without heading; and the steady motion."""
        steady = self.way(vehicle, label)
        row = blank_row(vehicle)
        row[g.KIND] = g.LEVEL
        row[g.DEPTH], row[g.ALTITUDE] = limit(self.depth_m), limit(self.altitude_m)
        row[g.MIN_ALTITUDE], row[g.MIN_DEPTH] = limit(self.min_altitude_m), self.min_depth_m
        row[g.CLIMB_PITCH] = math.radians(self.max_pitch_deg)
        row[g.DIVE_PITCH] = -row[g.CLIMB_PITCH]
        row[g.LEVEL_PITCH] = steady.pitch
        row[g.TURN_RATE] = 0.0
        row[g.LEVEL_TURN] = turn_factor(vehicle, steady)
        row[g.TURN_LIMIT] = turn_limit(vehicle, self.max_rotation_deg)
        row[g.DURATION] = limit(self.time(steady))
        command_of(vehicle, row, g.LEVEL_COMMAND)[:] = steady.command
        write_way(row, g.LEVEL_COMMAND, steady, vehicle)
        return row, steady

    def way_length(self) -> float | None:
        """Distance through the water [m] at which the leg ends; None: no such limit."""
        return None

    def time(self, steady: Way) -> float | None:
        """Time [s] until the leg's limit in steady motion; None: no limit."""
        duration, metres = getattr(self, "duration_s", None), self.way_length()
        times = [] if duration is None else [float(duration)]
        if metres is not None:
            times.append(metres / steady.speed)
        return min(times, default=None)

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Time [s] until its own limit, and the depth [m] that it keeps."""
        duration = self.time(self.way(vehicle, label))
        assert duration is not None
        return duration, depth if self.depth_m is None else self.depth_m


@dataclass(frozen=True, kw_only=True)
class Transect(Level):
    """Straight level leg on a heading, under a propeller."""

    kind = "transect"
    limits = ("length_m", "duration_s")

    heading_deg: float | None = None
    """Heading to hold [deg true]; None: the heading at the segment's start."""
    length_m: float | None = None
    """Limit: distance through the water [m], counted as time at the segment's speed."""
    duration_s: float | None = None
    """Limit: time [s]."""

    def way_length(self) -> float | None:
        """Distance `length_m` [m]; None: no such limit."""
        return self.length_m

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Level row with the heading loop."""
        row, _ = self.level_row(vehicle, label)
        row[g.HEADING] = heading(self.heading_deg)
        return row


@dataclass(frozen=True, kw_only=True)
class Circle(Level):
    """Level circle through the water: the heading setpoint turns at speed over radius."""

    kind = "circle"
    limits = ("turns", "duration_s")

    radius_m: float
    """Radius through the water [m], positive to starboard."""
    turns: float | None = None
    """Limit: number of full circles."""
    duration_s: float | None = None
    """Limit: time [s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(check.number(self.kind, "radius_m", self.radius_m)) > 0.0:
            check.fail(self.kind, "radius_m", self.radius_m, "a radius, positive to starboard")

    def way_length(self) -> float | None:
        """Circumference times `turns` [m]; None: no such limit."""
        return None if self.turns is None else 2.0 * math.pi * abs(self.radius_m) * self.turns

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Level row with a turning heading setpoint.

        Raises:
          MissionError: as for every level leg; or the rudder cannot turn it so tightly (the message
            gives the smallest radius).
        """
        row, steady = self.level_row(vehicle, label)
        turning = vehicle.steered_index("heading")
        if turning is None:
            raise MissionError(
                f"{label}: vehicle {vehicle.name!r} has no part that turns it: give a transect"
            )
        most = float(row[g.TURN_LIMIT])

        def command_on(radius: float) -> Array | None:
            """Commands on a circle of a radius [m], within the rudder's limit; else None."""
            try:
                command = circling(vehicle, steady, steady.speed / radius)
            except MissionError:
                return None
            return command if abs(command[turning]) <= most else None

        command = command_on(self.radius_m)
        if command is None:
            wider = (abs(self.radius_m) * 1.02**k for k in range(1, MOST_TRIES))
            least = next((r for r in wider if command_on(r) is not None), 0)
            rule = f"at least {least:.3g} m" if least else "a lower speed_m_s"
            rule += f" at {steady.speed:g} m/s, or a larger max_rotation_deg"
            name = vehicle.part_names[turning]
            check.fail(label, "radius_m", self.radius_m, f"{rule} (travel of the {name})")
        row[g.TURN_RATE] = steady.speed / self.radius_m
        command_of(vehicle, row, g.LEVEL_COMMAND)[:] = command
        return row


@dataclass(frozen=True, kw_only=True)
class LawnMower(Level):
    """Parallel legs back and forth with short crossings, at a depth or above the sea floor.

    Guidance counts every leg and every crossing as a segment of its own.
    """

    kind = "lawn-mower"

    heading_deg: float
    """Heading of the first leg [deg true]; the second leg comes back."""
    leg_length_m: float
    """Length of a leg through the water [m]."""
    spacing_m: float
    """Distance between legs [m]: positive moves to starboard of the first leg, negative to port."""
    legs: float
    """Number of legs."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(check.number(self.kind, "spacing_m", self.spacing_m)) > 0.0:
            check.fail(self.kind, "spacing_m", self.spacing_m, "a distance, positive to starboard")
        check.within(self.kind, "legs", self.legs, "", 1, MOST_LEGS)
        if self.legs % 1:
            check.fail(self.kind, "legs", self.legs, "a whole number")

    def flown_as(self) -> tuple[Transect, ...]:
        """Legs and crossings as transects, in order."""
        level = {f.name: getattr(self, f.name) for f in dataclasses.fields(Level)}
        across = self.heading_deg + (90.0 if self.spacing_m > 0.0 else -90.0)
        ways: list[tuple[float, float]] = []
        for leg in range(int(self.legs)):
            if leg:
                ways.append((across, abs(self.spacing_m)))
            ways.append((self.heading_deg + 180.0 * (leg % 2), self.leg_length_m))
        return tuple(
            Transect(heading_deg=toward % 360.0, length_m=length, **level)
            for toward, length in ways
        )

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Sum of the times [s] of all transects, and the depth [m] of the last."""
        each = [part.expected(vehicle, depth, label) for part in self.flown_as()]
        return sum(time for time, _ in each), each[-1][1]
