"""Saw-tooth: dives and climbs on a heading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.profile import Profile
from twin.mission.way import heading, turn_limit
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class SawTooth(Profile):
    """Wings-level dives and climbs on a heading."""

    kind: ClassVar[str] = "saw-tooth"

    heading_deg: float | None = None
    """Heading to hold [deg true]; None: the heading at the segment's start."""
    max_rotation_deg: float = 45.0
    """Limit of the heading loop [deg]: of a battery's rotation or a rudder's deflection; a glider
    rolls less than it turns its battery."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check.optional(check.heading, self.kind, "heading_deg", self.heading_deg)
        field, value = "max_rotation_deg", self.max_rotation_deg
        check.within(self.kind, field, value, "deg", 0.0, 90.0, open_low=True)

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """A profile with the heading loop."""
        row = super().row(vehicle, label)
        row[g.KIND] = g.SAW_TOOTH
        row[g.HEADING] = heading(self.heading_deg)
        row[g.TURN_LIMIT] = turn_limit(vehicle, self.max_rotation_deg)
        return row
