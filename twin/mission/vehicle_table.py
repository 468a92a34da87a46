"""The shipped vehicles, a line each: what they are, their speed, where their numbers are from."""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin.mission.glide import steady_glide
from twin.vehicle.shipped import vehicle_names
from twin.vehicle.vehicle import Vehicle, load_vehicle

MISSING = "-"
"""In a cell without a value"""


@dataclass(frozen=True, kw_only=True)
class VehicleLine:
    """One shipped vehicle; None where it lacks the part, or does not glide."""

    name: str
    summary: str
    mass_kg: float
    propeller_high_rad_s: float | None
    """largest rate of its propeller"""
    pump_low_cm3: float | None
    """end of the pump's travel at which it is heaviest"""
    pump_high_cm3: float | None
    pump_rate_cm3_s: float | None
    turns_by: str
    """name of the part that turns it"""
    pitch_deg: float | None
    """magnitude in its usual glide"""
    net_mass_kg: float | None
    """magnitude in its usual glide"""
    speed_m_s: float
    """through the water, in still water of the reference density: in its usual glide down, or of a
    propelled vehicle its cruise"""
    climb_speed_m_s: float | None
    """likewise up"""
    vertical_speed_m_s: float | None
    """down, in its usual glide"""
    source: str

    @classmethod
    def of(cls, vehicle: Vehicle) -> VehicleLine:
        """The line of a vehicle; MissionError when it cannot glide as its file says it does."""
        pump, propeller = vehicle.steered("buoyancy"), vehicle.steered("speed")
        pitch, net_mass = vehicle.usual_glide
        dive = climb = None
        if propeller is None:
            dive, climb = (steady_glide(vehicle, -s * pitch, s * net_mass) for s in (1.0, -1.0))
        return cls(
            name=vehicle.name,
            summary=vehicle.summary,
            mass_kg=vehicle.mass,
            propeller_high_rad_s=None if propeller is None else propeller.high,
            pump_low_cm3=None if pump is None else pump.low,
            pump_high_cm3=None if pump is None else pump.high,
            pump_rate_cm3_s=None if pump is None else pump.rate,
            turns_by=vehicle.steering.get("heading", ""),
            pitch_deg=None if dive is None else math.degrees(pitch),
            net_mass_kg=None if dive is None else net_mass,
            speed_m_s=vehicle.cruise_speed if dive is None else dive.speed,
            climb_speed_m_s=None if climb is None else climb.speed,
            vertical_speed_m_s=None if dive is None else dive.vertical_speed,
            source=vehicle.source,
        )

    def cells(self) -> dict[str, str]:
        """What a person reads of it, by the heading of its column."""
        pump = MISSING
        if self.pump_low_cm3 is not None:
            pump = f"{self.pump_low_cm3:.0f} to {self.pump_high_cm3:.0f}"
        return {
            "vehicle": self.name,
            "mass kg": f"{self.mass_kg:.1f}",
            "propeller rad/s": _cell(self.propeller_high_rad_s, "g"),
            "pump cm3": pump,
            "cm3/s": _cell(self.pump_rate_cm3_s, "g"),
            "turned by": self.turns_by or MISSING,
            "pitch deg": _cell(self.pitch_deg, ".0f"),
            "net mass kg": _cell(self.net_mass_kg, ".2f"),
            "speed m/s": f"{self.speed_m_s:.2f}",
            "down m/s": _cell(self.vertical_speed_m_s, ".2f"),
        }


def _cell(value: float | None, form: str) -> str:
    return MISSING if value is None else format(value, form)


def shipped_vehicles() -> list[VehicleLine]:
    """Every shipped vehicle, by name."""
    return [VehicleLine.of(load_vehicle(name)) for name in vehicle_names()]
