"""Hold: fixed positions of the parts, an open-loop manoeuvre."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from twin.errors import MissionError
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import Segment, blank_row, command_of, limit
from twin.mission.way import (
    check_net_mass,
    checked_part,
    checked_rotation,
    checked_shift,
    reject_missing,
)
from twin.numbers import Array
from twin.vehicle.parts import BatterySlide
from twin.vehicle.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class Hold(Segment):
    """Fixed actuator positions, no loop closed: an open-loop manoeuvre."""

    kind: ClassVar[str] = "hold"
    limits = ("duration_s", "until_depth_m")

    shift_m: float = 0.0
    """Battery displacement from neutral [m], positive forward (nose down)."""
    rotation_deg: float = 0.0
    """Battery rotation [deg], positive turns to starboard."""
    net_mass_kg: float = 0.0
    """Net buoyancy mass [kg], with its sign: positive is heavy."""
    parts: Mapping[str, float] = field(default_factory=dict)
    """Positions by part, in the parts' units (rad, m, cm3, rad/s), for vehicles with others than
    these three: `parts = { propeller = 30.0, rudder = 0.1 }`."""
    duration_s: float | None = None
    """Limit: time [s]."""
    until_depth_m: float | None = None
    """Limit: the segment ends when the glider passes this depth [m]."""

    def __post_init__(self) -> None:
        kind = self.kind
        check.number(kind, "shift_m", self.shift_m)
        check.rotation(kind, "rotation_deg", self.rotation_deg)
        check.number(kind, "net_mass_kg", self.net_mass_kg)
        if not isinstance(self.parts, Mapping):
            check.fail(kind, "parts", self.parts, "a table of positions by part")
        for name, value in self.parts.items():
            check.number(kind, f"parts.{name}", value)
        check.optional(check.limit, kind, "duration_s", self.duration_s, "s")
        check.optional(check.within, kind, "until_depth_m", self.until_depth_m, "m", 0.0)

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """One command."""
        reject_missing(vehicle, label, self)
        row = blank_row(vehicle)
        row[g.KIND] = g.HOLD
        rest = command_of(vehicle, row, g.REST_COMMAND)
        pitching = vehicle.steered("pitch")
        if isinstance(pitching, BatterySlide):
            place = vehicle.part_names.index(pitching.name)
            rest[place] = checked_shift(vehicle, label, self.shift_m)
        turning, pump = vehicle.steered_index("heading"), vehicle.steered_index("buoyancy")
        if turning is not None:
            rest[turning] = checked_rotation(vehicle, label, "rotation_deg", self.rotation_deg)
        if pump is not None:
            check_net_mass(vehicle, label, "net_mass_kg", self.net_mass_kg)
            rest[pump] = vehicle.pump_for_net_mass(self.net_mass_kg)
        for name, value in self.parts.items():
            rest[checked_part(vehicle, label, name, value)] = value
        row[g.DURATION] = limit(self.duration_s)
        row[g.UNTIL_DEPTH] = limit(self.until_depth_m)
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Its own clock: an open loop to a depth has no speed known beforehand."""
        if self.duration_s is None:
            raise MissionError(
                f"{label}: a hold until a depth takes an unknown time: give it a duration_s as "
                "well, or give the mission one"
            )
        return self.duration_s, depth
