"""Ballast: the mass at which a vehicle is neutral in the water that it flies in."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle
    from twin.water.density import DensityProfile


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ballast:
    """Neutral, but for an error, at a depth of the mission's own water."""

    depth: float
    """[m] where it is neutral"""
    heavy: float = 0.0
    """[kg] that it is too heavy there"""

    def neutral_volume(self, vehicle: Vehicle, density: DensityProfile | None) -> float:
        """Volume [m3] at zero pressure that makes `vehicle` so, its pumps at neutral."""
        there = vehicle.reference_density if density is None else float(density.density(self.depth))
        pressure = vehicle.reference_density * vehicle.gravity * self.depth
        squeezed = 1.0 - vehicle.hull_compressibility * pressure
        if not self.heavy and density is None and not vehicle.hull_compressibility:
            return vehicle.neutral_volume
        return (vehicle.mass - self.heavy) / (there * squeezed)
