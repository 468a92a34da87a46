"""Transect: straight ahead on a heading, at a depth or above the sea floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import limit
from twin.mission.segments.level import Level
from twin.mission.way import Way, heading
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class Transect(Level):
    """A level way on a heading, under a propeller."""

    kind: ClassVar[str] = "transect"
    limits = ("length_m", "duration_s")

    heading_deg: float | None = None
    """Heading to hold [deg true]; None: the heading at the segment's start."""
    length_m: float | None = None
    """Limit: distance through the water [m], as time at the segment's speed."""
    duration_s: float | None = None
    """Limit: time [s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check.optional(check.heading, self.kind, "heading_deg", self.heading_deg)
        check.optional(check.limit, self.kind, "length_m", self.length_m, "m")
        check.optional(check.limit, self.kind, "duration_s", self.duration_s, "s")

    def _duration(self, steady: Way) -> float | None:
        """[s] until its limit; None: it has none."""
        times = [] if self.duration_s is None else [float(self.duration_s)]
        if self.length_m is not None:
            times.append(self.length_m / steady.speed)
        return min(times, default=None)

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """A level row with the heading loop."""
        row, steady = self.level_row(vehicle, label)
        row[g.HEADING] = heading(self.heading_deg)
        row[g.DURATION] = limit(self._duration(steady))
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Its own clock."""
        duration = self._duration(self.way(vehicle, label))
        assert duration is not None
        return duration, self.deepest(depth)
