"""Leak: water in the hull."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

from twin.faults.base import Condition, Fault

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

LITRE = 1e-3
"""[m3]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class WaterTaken(Fault):
    """A seal that lets water in, a little all the time."""

    kind: ClassVar[str] = "water_taken"
    says: ClassVar[str] = "water in the hull"
    size_name: ClassVar[str] = "per_day"
    unit: ClassVar[str] = "L d-1"
    sizes: ClassVar[tuple[float, float]] = (0.02, 0.08)
    grows: ClassVar[bool] = True
    most: ClassVar[float] = 10.0
    source: ClassVar[str] = (
        "ours: from what a pump's reach of 0.2 L hides for ten days to what it hides for two"
    )
    shows: ClassVar[str] = "faster dives, slower climbs, less vacuum, trim by the bow or stern"
    otherwise: ClassVar[str] = "fresher or warmer water; air in the oil; the hull's temperature"
    find_out: ClassVar[str] = "read the leak detectors and the vacuum at equal temperature; recover"

    per_day: float = 0.04
    """[L] taken a day"""
    place: float = -0.25
    """where it gathers, over the hull's length, positive forward of the middle"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Every hull can leak; what glides shows it."""
        return "" if vehicle.steered("buoyancy") is not None else "has no pump to trim against it"

    def problems(self) -> list[str]:
        """It gathers in the hull."""
        if not -0.5 <= self.place <= 0.5:
            return [f"place = {self.place:g} must lie within -0.5 and 0.5"]
        return []

    def change(self, condition: Condition, size: float) -> Condition:
        """A mass low in the hull, which displaces nothing more."""
        vehicle = condition.vehicle
        at = (self.place * vehicle.hull_length, 0.0, 0.4 * vehicle.hull_diameter)
        mass = size * LITRE * vehicle.reference_density
        return condition.with_mass(mass, at).replace(taken=condition.taken + size * LITRE)
