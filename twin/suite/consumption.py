"""Consumption: electrical energy that a vehicle's parts and electronics take.

Each part says what a move of it takes. Pumping oil out against the sea costs, letting it in takes
a valve; a battery is moved by a screw against friction and its own weight, and nothing is won
back. The defaults are ours, of the size that small gliders have; none of them is published for the
vehicles here.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Consumption:
    """Losses of the parts and power of the electronics."""

    hotel_power: float = 0.5
    """[W] electronics and sensors, all the time"""
    pump_efficiency: float = 0.5
    """hydraulic over electrical power of the pump"""
    hull_vacuum: float = 3e4
    """[Pa] below the sea-level pressure inside the hull; the pump works against it too"""
    screw_efficiency: float = 0.4
    """mechanical over electrical power of the battery's drives"""
    rail_friction: float = 0.1
    """friction over weight of the sliding battery"""
    bearing_torque: float = 0.2
    """[N m] friction of the turning battery"""
    propeller_efficiency: float = 0.7
    """mechanical over electrical power of a propeller's motor and gear"""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"consumption: {field.name} = {value} must be 0 or more")
        for name in ("pump_efficiency", "screw_efficiency", "propeller_efficiency"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InputError(f"consumption: {name} must be above 0 and at most 1")

    def energy(
        self,
        vehicle: Vehicle,
        before: Array,
        after: Array,
        *,
        depth: float,
        pitch: float,
        duration: float,
    ) -> float:
        """Energy [J] of one short move.

        Args:
          before, after: positions of the parts, in their order and units, shape (parts,).
          depth: [m]. pitch: [rad]. duration: [s].
        """
        total = self.hotel_power * duration
        for part, start, end in zip(vehicle.parts, before, after, strict=True):
            total += part.energy(
                vehicle, float(start), float(end), self, depth=depth, pitch=pitch, duration=duration
            )
        return total


def cost_of_transport(vehicle: Vehicle, energy: float, distance: float) -> float:
    """Energy [J] over weight times distance [m], dimensionless; infinite without progress."""
    if distance <= 0.0:
        return math.inf
    return energy / (vehicle.mass * vehicle.gravity * distance)
