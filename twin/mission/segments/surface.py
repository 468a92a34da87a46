"""Surface: a climb to the surface and a stay there, for a fix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import Segment, blank_row, command_of, write_way
from twin.mission.turning import turn_factor
from twin.mission.way import (
    TIME_MARGIN,
    Way,
    check_net_mass,
    checked_shift,
    heading,
    reject_missing,
    turn_limit,
    way,
)
from twin.numbers import Array
from twin.vehicle.parts import BatterySlide
from twin.vehicle.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class Surface(Segment):
    """Climb to the surface and stay there for a time, tail up with the antenna out of the water."""

    kind: ClassVar[str] = "surface"

    duration_s: float = 300.0
    """Time at the surface [s], counted from the arrival."""
    pitch_deg: float = 35.0
    """Pitch magnitude of the ascent [deg]."""
    net_mass_kg: float | None = None
    """Magnitude of the lightness [kg]; None: all that the pump has."""
    speed_m_s: float | None = None
    """Speed of the ascent [m/s] of a vehicle with a propeller; None: its cruising speed."""
    heading_deg: float | None = None
    """Heading of the ascent [deg true]; None: the heading at the segment's start."""
    max_rotation_deg: float = 45.0
    """Limit of the heading loop during the ascent [deg]."""
    shift_m: float | None = None
    """Battery position while at the surface [m]; None: all the way forward, tail up. Of vehicles
    that a battery pitches."""

    def __post_init__(self) -> None:
        kind = self.kind
        check.limit(kind, "duration_s", self.duration_s, "s")
        check.pitch(kind, "pitch_deg", self.pitch_deg)
        check.optional(check.net_mass, kind, "net_mass_kg", self.net_mass_kg)
        check.optional(check.limit, kind, "speed_m_s", self.speed_m_s, "m/s")
        check.optional(check.heading, kind, "heading_deg", self.heading_deg)
        field, value = "max_rotation_deg", self.max_rotation_deg
        check.within(kind, field, value, "deg", 0.0, 90.0, open_low=True)
        check.optional(check.number, kind, "shift_m", self.shift_m)

    def _ascent(self, vehicle: Vehicle, label: str) -> Way:
        """The steady climb."""
        reject_missing(vehicle, label, self)
        mass = 0.0
        pump = vehicle.steered("buoyancy")
        if pump is not None:
            mass = vehicle.net_mass_for_pump(float(pump.high))
            if self.net_mass_kg is not None:
                mass = -self.net_mass_kg
                check_net_mass(vehicle, label, "net_mass_kg", mass)
        return way(
            vehicle,
            label,
            "pitch_deg",
            self.pitch_deg,
            mass,
            self.speed_m_s,
            # what an elevator cannot hold is made up by the pump on the way up
            within_travel=not isinstance(vehicle.steered("pitch"), BatterySlide),
        )

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """A climb with the heading loop, then a rest with the tail up."""
        row = blank_row(vehicle)
        climb = self._ascent(vehicle, label)
        row[g.KIND] = g.SURFACE
        row[g.CLIMB_PITCH] = climb.pitch
        row[g.CLIMB_TURN] = turn_factor(vehicle, climb)
        command_of(vehicle, row, g.CLIMB_COMMAND)[:] = climb.command
        write_way(row, g.CLIMB_COMMAND, climb, vehicle)
        rest = command_of(vehicle, row, g.REST_COMMAND)
        pump, pitching = vehicle.steered_index("buoyancy"), vehicle.steered("pitch")
        if pump is not None:
            rest[pump] = climb.command[pump]
        if isinstance(pitching, BatterySlide):
            place = vehicle.part_names.index(pitching.name)
            rest[place] = pitching.high
            if self.shift_m is not None:
                rest[place] = checked_shift(vehicle, label, self.shift_m)
        row[g.DURATION] = self.duration_s
        row[g.HEADING] = heading(self.heading_deg)
        row[g.TURN_LIMIT] = turn_limit(vehicle, self.max_rotation_deg)
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """The climb with a margin, and the stay."""
        climb = self._ascent(vehicle, label)
        return TIME_MARGIN * depth / -climb.vertical_speed + self.duration_s, 0.0
