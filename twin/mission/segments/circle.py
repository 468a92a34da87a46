"""Circle: round and round at a depth or above the sea floor, with a given radius."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import MissionError
from twin.mission import fields as check
from twin.mission import table as g
from twin.mission.segments.base import command_of, limit
from twin.mission.segments.level import Level
from twin.mission.turning import turn_per_position
from twin.mission.way import Way

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Circle(Level):
    """A level circle through the water: the wanted heading turns at speed over radius."""

    kind: ClassVar[str] = "circle"

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
        if self.turns is not None:
            check.limit(self.kind, "turns", self.turns, "")
        if self.duration_s is not None:
            check.limit(self.kind, "duration_s", self.duration_s, "s")

    @property
    def limited(self) -> bool:
        """Whether the segment ends by itself."""
        return self.turns is not None or self.duration_s is not None

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
        rate = steady.speed / self.radius_m
        per_position = turn_per_position(vehicle, steady)
        most = abs(per_position) * float(row[g.TURN_LIMIT])
        if abs(rate) > most:
            rule = (
                f"at least {math.ceil(steady.speed / most)} m at {steady.speed:g} m/s, or a larger "
                f"max_rotation_deg (travel of the {vehicle.part_names[turning]})"
            )
            check.fail(label, "radius_m", self.radius_m, rule)
        row[g.TURN_RATE] = rate
        command_of(vehicle, row, g.LEVEL_COMMAND)[turning] = rate / per_position
        row[g.DURATION] = limit(self._duration(steady))
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Its own clock."""
        duration = self._duration(self.way(vehicle, label))
        assert duration is not None
        return duration, self.deepest(depth)
