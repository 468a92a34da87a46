"""Ballast: the mass at which a vehicle is neutral in the water that it flies in."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from twin.errors import InputError

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle
    from twin.water.density import DensityProfile


DEEPEST_SEA = 11_000.0
"""[m]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ballast:
    """How a vehicle was weighed: neutral, but for an error, at a depth; or with a known volume."""

    depth: float | None = None
    """[m] of the mission's own water, where it is neutral"""
    heavy: float = 0.0
    """[kg] that it is too heavy there"""
    volume: float | None = None
    """[m3] that the hull displaces at zero pressure and its reference temperature, in place of
    `depth`"""

    def __post_init__(self) -> None:
        if (self.depth is None) == (self.volume is None):
            raise InputError("ballast: give either a depth or a volume")
        if self.volume is not None and (self.heavy or not self.volume > 0.0):
            raise InputError("ballast: a volume [m3] is positive and needs no `heavy`")

    def neutral_volume(self, vehicle: Vehicle, density: DensityProfile | None) -> float:
        """Volume [m3] at zero pressure that makes `vehicle` so, its pumps at neutral.

        At its depth the hull has the temperature of the water.
        """
        if self.volume is not None:
            return self.volume
        assert self.depth is not None
        pressure = vehicle.reference_density * vehicle.gravity * self.depth
        strain = -vehicle.hull_compressibility * pressure
        there = vehicle.reference_density
        if density is not None:
            there = float(density.density(self.depth))
            water = density.temperature_salinity(self.depth)
            if water is not None:
                warming = float(water[0]) - vehicle.hull_reference_temperature
                strain += vehicle.hull_thermal_expansion * warming
        if not self.heavy and density is None and not strain:
            return vehicle.neutral_volume
        return (vehicle.mass - self.heavy) / (there * (1.0 + strain))


def weighed(
    vehicle: Vehicle,
    *,
    ballast_at: float | None = None,
    mass: float | None = None,
    compressibility: float | None = None,
) -> tuple[Vehicle, Ballast | None]:
    """A vehicle as it was prepared for its mission, and its ballast where that says more.

    Args:
      ballast_at: [m] where it is neutral in the mission's water.
      mass: [kg] of the whole vehicle; the volume of its hull stays, unless `ballast_at` sets it.
      compressibility: [1/Pa] of its hull.

    Raises:
      InputError, VehicleError: impossible values.
    """
    volume = vehicle.neutral_volume
    if compressibility is not None:
        vehicle = vehicle.replace(hull_compressibility=compressibility)
    if mass is not None:
        if not 0.5 * vehicle.mass <= mass <= 1.5 * vehicle.mass:
            raise InputError(
                f"mass {mass:g} kg: vehicle {vehicle.name!r} has {vehicle.mass:g} kg; give a mass "
                "near that"
            )
        fixed = vehicle.static_mass + mass - vehicle.mass
        vehicle = vehicle.replace(static_mass=fixed)
    if ballast_at is not None:
        if not 0.0 <= ballast_at <= DEEPEST_SEA:
            raise InputError(f"ballast_at {ballast_at:g} m: a depth is from 0 to {DEEPEST_SEA:g} m")
        return vehicle, Ballast(depth=ballast_at)
    return vehicle, None if mass is None else Ballast(volume=volume)


def out_of_trim(vehicle: Vehicle, ballast: Ballast | None, density: DensityProfile | None) -> str:
    """That a vehicle is heavier or lighter at the surface than its pump can carry; else empty."""
    part = vehicle.steered("buoyancy")
    if ballast is None or part is None:
        return ""
    water = vehicle.reference_density if density is None else float(density.density(0.0))
    net = vehicle.mass - water * ballast.neutral_volume(vehicle, density)
    lightest, heaviest = vehicle.net_mass_range
    reach = -lightest if net > 0.0 else heaviest
    if abs(net) <= reach:
        return ""
    word, fate = ("heavy", "climb") if net > 0.0 else ("light", "dive")
    return (
        f"vehicle {vehicle.name!r} is {abs(net):.2f} kg {word} at the surface of this water, and "
        f"its {part.name} carries {reach:.2f} kg: it will not {fate}; --ballast-at 0 makes it "
        "neutral there, as does another --mass"
    )
