"""Compass iron: a magnetic field of the vehicle's own that has changed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from twin.faults.base import Array, Condition, Fault, Readings

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle


@dataclasses.dataclass(frozen=True, kw_only=True)
class CompassIron(Fault):
    """Hard iron that came or went: a battery that was magnetised, a loosened screw."""

    kind: ClassVar[str] = "compass_iron"
    says: ClassVar[str] = "the compass' iron has changed"
    size_name: ClassVar[str] = "degrees"
    unit: ClassVar[str] = "degree"
    sizes: ClassVar[tuple[float, float]] = (4.0, 15.0)
    signed: ClassVar[bool] = True
    most: ClassVar[float] = 60.0
    source: ClassVar[str] = (
        "OceanGliders' procedure for depth-averaged currents: 1 deg or less calibrated, usually up "
        "to 5 without; more where a battery pack is exchanged"
    )
    shows: ClassVar[str] = "currents that seem to turn with the heading; the gyro's turns"
    otherwise: ClassVar[str] = "a current that turns while it flies that heading"
    find_out: ClassVar[str] = "fly two legs on opposite headings, or a spiral, and compare"

    degrees: float = 8.0
    """[degree] largest deviation"""
    toward: float = 0.0
    """[degree] heading at which there is none and from which on it is positive"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Guidance steers by the deviation, a sine of the heading."""
        sine, cosine = condition.iron
        most, toward = math.radians(size), math.radians(self.toward)
        iron = (sine + most * math.cos(toward), cosine - most * math.sin(toward))
        return condition.replace(iron=iron)

    def expected(self, way: Array) -> Mapping[str, Array]:
        """The current that a wrong heading makes of the way through the water."""
        north, east = way.T
        heading = np.arctan2(east, north)
        off = math.radians(1.0) * np.sin(heading - math.radians(self.toward))
        return {"current_north": off * east, "current_east": -off * north}

    def choices(self, vehicle: Vehicle) -> tuple[Mapping[str, Any], ...]:
        """Headings a fourth of a half turn apart: the size has a sign."""
        return tuple({"toward": 45.0 * k} for k in range(4))

    def readings(
        self, signals: Readings, size: Array, period: float, rng: np.random.Generator
    ) -> Readings:
        """A heading that is off by it; nothing where it has no compass."""
        heading = signals.get("measured_heading")
        if heading is None:
            return {}
        off = size * np.sin(np.deg2rad(heading - self.toward))
        return {"measured_heading": np.mod(heading + off, 360.0)}
