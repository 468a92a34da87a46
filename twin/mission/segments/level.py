"""Level: ways at a depth, or at a height above the sea floor; what transects and circles share."""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin.errors import MissionError
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import Segment, blank_row, command_of, limit, write_way
from twin.mission.turning import turn_factor
from twin.mission.way import Way, level_way, reject_missing, turn_limit
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle

MAX_PITCH_DEG = 20.0
"""Usual limit of the pitch on the way to a depth, as the LRAUV's yo-yos have it."""
SHALLOWEST_M = 2.0
"""Usual least depth of a way that follows the sea floor: the propeller stays under water."""


def check_place(kind: str, depth_m: float | None, altitude_m: float | None) -> None:
    """Raise MissionError unless exactly one of depth and altitude is given, and possible."""
    if (depth_m is None) == (altitude_m is None):
        raise MissionError(
            f"{kind}: give either depth_m or altitude_m (above the sea floor), "
            f"{'not both' if depth_m is not None else 'one of them is needed'}"
        )
    if depth_m is not None:
        check.within(kind, "depth_m", depth_m, "m", 0.0, open_low=True)
    else:
        check.limit(kind, "altitude_m", altitude_m, "m")


@dataclass(frozen=True, kw_only=True)
class Level(Segment):
    """A way at a depth or altitude under a propeller; the base of `Transect` and `Circle`."""

    depth_m: float | None = None
    """Depth to keep [m]; this or `altitude_m`."""
    altitude_m: float | None = None
    """Height above the sea floor to keep [m]; of runs with a sea floor."""
    min_altitude_m: float | None = None
    """The vehicle rises above its depth where the sea floor comes nearer than this [m]; None: it
    does not look."""
    min_depth_m: float = SHALLOWEST_M
    """A way at an altitude comes no shallower than this [m]."""
    speed_m_s: float | None = None
    """Speed through the water [m/s]; None: the vehicle's cruising speed."""
    max_pitch_deg: float = MAX_PITCH_DEG
    """Largest pitch, up or down, that the depth loop may ask for [deg]."""
    max_rotation_deg: float = 45.0
    """Limit of the heading loop [deg] within the rudder's own."""

    def __post_init__(self) -> None:
        kind = self.kind
        check_place(kind, self.depth_m, self.altitude_m)
        check.optional(check.limit, kind, "min_altitude_m", self.min_altitude_m, "m")
        check.within(kind, "min_depth_m", self.min_depth_m, "m", 0.0)
        check.optional(check.limit, kind, "speed_m_s", self.speed_m_s, "m/s")
        check.pitch(kind, "max_pitch_deg", self.max_pitch_deg)
        field, value = "max_rotation_deg", self.max_rotation_deg
        check.within(kind, field, value, "deg", 0.0, 90.0, open_low=True)

    def way(self, vehicle: Vehicle, label: str) -> Way:
        """The steady level way; raises MissionError when the vehicle cannot fly it."""
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
        """A row that keeps the depth, still without heading and limits; and its steady way."""
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
        command_of(vehicle, row, g.LEVEL_COMMAND)[:] = steady.command
        write_way(row, g.LEVEL_COMMAND, steady, vehicle)
        return row, steady

    def deepest(self, depth: float) -> float:
        """Depth [m] that it may end at, from `depth`."""
        return depth if self.depth_m is None else self.depth_m
