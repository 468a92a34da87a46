"""Circle: round and round at a depth or above the sea floor, with a given radius."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from twin.errors import MissionError
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import command_of, limit
from twin.mission.segments.level import Level
from twin.mission.turning import circling
from twin.mission.way import Way
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle

MOST_TRIES = 300
"""Wider circles that are tried, each 2 % wider, to say which one is possible"""


@dataclass(frozen=True, kw_only=True)
class Circle(Level):
    """A level circle through the water: the wanted heading turns at speed over radius."""

    kind: ClassVar[str] = "circle"
    limits = ("turns", "duration_s")

    radius_m: float
    """[m] through the water, positive to starboard."""
    turns: float | None = None
    """Limit: number of full circles."""
    duration_s: float | None = None
    """Limit: time [s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(check.number(self.kind, "radius_m", self.radius_m)) > 0.0:
            check.fail(self.kind, "radius_m", self.radius_m, "a radius, positive to starboard")
        check.optional(check.limit, self.kind, "turns", self.turns, "")
        check.optional(check.limit, self.kind, "duration_s", self.duration_s, "s")

    def _duration(self, steady: Way) -> float | None:
        times = [] if self.duration_s is None else [float(self.duration_s)]
        if self.turns is not None:
            times.append(2.0 * math.pi * abs(self.radius_m) * self.turns / steady.speed)
        return min(times, default=None)

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """A level row whose wanted heading turns.

        Raises:
          MissionError: as every level way, or its rudder cannot turn it so tightly (the smallest
            radius is named).
        """
        row, steady = self.level_row(vehicle, label)
        turning = vehicle.steered_index("heading")
        if turning is None:
            raise MissionError(
                f"{label}: vehicle {vehicle.name!r} has no part that turns it: give a transect"
            )
        most = float(row[g.TURN_LIMIT])
        command = self._command(vehicle, steady, self.radius_m, most)
        if command is None:
            wider = (abs(self.radius_m) * 1.02**k for k in range(1, MOST_TRIES))
            least = next(
                (r for r in wider if self._command(vehicle, steady, r, most) is not None), 0
            )
            rule = f"at least {least:.3g} m" if least else "a lower speed_m_s"
            rule += f" at {steady.speed:g} m/s, or a larger max_rotation_deg"
            name = vehicle.part_names[turning]
            check.fail(label, "radius_m", self.radius_m, f"{rule} (travel of the {name})")
        assert command is not None
        row[g.TURN_RATE] = steady.speed / self.radius_m
        command_of(vehicle, row, g.LEVEL_COMMAND)[:] = command
        row[g.DURATION] = limit(self._duration(steady))
        return row

    @staticmethod
    def _command(vehicle: Vehicle, steady: Way, radius: float, most: float) -> Array | None:
        """Of all parts on a circle [m] with at most so much rudder [rad]; None: there is none."""
        try:
            command = circling(vehicle, steady, steady.speed / radius)
        except MissionError:
            return None
        return command if abs(command[vehicle.steered_index("heading")]) <= most else None

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Its own clock."""
        duration = self._duration(self.way(vehicle, label))
        assert duration is not None
        return duration, self.deepest(depth)
