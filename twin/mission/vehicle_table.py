"""The shipped vehicles, a line each: what they are, how fast they glide, where it is from."""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin.mission.glide import steady_glide
from twin.vehicle.vehicle import Vehicle, load_vehicle, vehicle_names


@dataclass(frozen=True, kw_only=True)
class VehicleLine:
    """One shipped vehicle."""

    name: str
    summary: str
    mass_kg: float
    pump_low_cm3: float
    """end of the pump's travel at which it is heaviest"""
    pump_high_cm3: float
    pump_rate_cm3_s: float
    turns_by: str
    """name of the part that turns it"""
    pitch_deg: float
    """magnitude in its usual glide"""
    net_mass_kg: float
    """magnitude in its usual glide"""
    speed_m_s: float
    """through the water, in its usual glide down, in still water of the reference density"""
    climb_speed_m_s: float
    """likewise up"""
    vertical_speed_m_s: float
    """down, likewise"""
    source: str

    @classmethod
    def of(cls, vehicle: Vehicle) -> VehicleLine:
        """The line of a glider; MissionError when it cannot glide as its file says it usually does.

        Raises:
          VehicleError: it has no pump.
        """
        pump = vehicle.part(vehicle.steering.get("buoyancy", "pump"))
        pitch, net_mass = vehicle.usual_glide
        dive, climb = (steady_glide(vehicle, -s * pitch, s * net_mass) for s in (1.0, -1.0))
        return cls(
            name=vehicle.name,
            summary=vehicle.summary,
            mass_kg=vehicle.mass,
            pump_low_cm3=pump.low,
            pump_high_cm3=pump.high,
            pump_rate_cm3_s=pump.rate,
            turns_by=vehicle.steering.get("heading", ""),
            pitch_deg=math.degrees(pitch),
            net_mass_kg=net_mass,
            speed_m_s=dive.speed,
            climb_speed_m_s=climb.speed,
            vertical_speed_m_s=dive.vertical_speed,
            source=vehicle.source,
        )

    def cells(self) -> dict[str, str]:
        """What a person reads of it, by the heading of its column."""
        return {
            "vehicle": self.name,
            "mass kg": f"{self.mass_kg:.1f}",
            "pump cm3": f"{self.pump_low_cm3:.0f} to {self.pump_high_cm3:.0f}",
            "cm3/s": f"{self.pump_rate_cm3_s:g}",
            "turned by": self.turns_by,
            "pitch deg": f"{self.pitch_deg:.0f}",
            "net mass kg": f"{self.net_mass_kg:.2f}",
            "speed m/s": f"{self.speed_m_s:.2f}",
            "down m/s": f"{self.vertical_speed_m_s:.2f}",
        }


def shipped_vehicles() -> list[VehicleLine]:
    """Every shipped vehicle, by name."""
    return [VehicleLine.of(load_vehicle(name)) for name in vehicle_names()]
