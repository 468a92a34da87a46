"""Spiral: dives and climbs while turning all the time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.errors import MissionError
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import command_of
from twin.mission.segments.profile import Profile
from twin.mission.way import checked_rotation
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class Spiral(Profile):
    """Dives and climbs at a fixed battery rotation or rudder; the heading loop rests."""

    kind: ClassVar[str] = "spiral"

    rotation_deg: float
    """Position of the turning part [deg], a battery's rotation or a rudder's deflection; a
    battery's positive one turns to starboard, in a dive and in a climb."""
    climb_rotation_deg: float | None = None
    """The same in the climb [deg]; None: that of the dive."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check.rotation(self.kind, "rotation_deg", self.rotation_deg)
        check.optional(check.rotation, self.kind, "climb_rotation_deg", self.climb_rotation_deg)

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """A profile with a fixed position of what turns the vehicle."""
        row = super().row(vehicle, label)
        row[g.KIND] = g.SPIRAL
        turning = vehicle.steered_index("heading")
        if turning is None:
            raise MissionError(
                f"{label}: vehicle {vehicle.name!r} has no part that turns it: give a saw-tooth"
            )
        dive = checked_rotation(vehicle, label, "rotation_deg", self.rotation_deg)
        climb = dive
        if self.climb_rotation_deg is not None:
            field, rotation = "climb_rotation_deg", self.climb_rotation_deg
            climb = checked_rotation(vehicle, label, field, rotation)
        command_of(vehicle, row, g.DIVE_COMMAND)[turning] = dive
        command_of(vehicle, row, g.CLIMB_COMMAND)[turning] = climb
        return row
