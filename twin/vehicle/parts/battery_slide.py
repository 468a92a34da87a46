"""Battery slide: a mass that moves along the hull and so pitches the vehicle."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from twin.vehicle.changes import Uncertainty
from twin.vehicle.parts.base import Array, Carrier, Losses, Part, Quantity

SHIFT = (0.008, 0.03)
"""[m] of a travel of 0.05 m: commands that a random manoeuvre draws"""
TRAVEL = 0.05
"""[m] that SHIFT belongs to"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class BatterySlide(Part):
    """A mass on a slide along the hull; its position is positive forward: nose down."""

    kind: ClassVar[str] = "battery-slide"
    unit: ClassVar[str] = "m"
    quantity: ClassVar[Quantity] = Quantity(
        unit="m",
        scale=1.0,
        long_name="displacement from neutral, forward positive",
        limits=(-1.0, 1.0),
    )
    joint: ClassVar[str | None] = "slide"
    turn: ClassVar[int] = 20

    def controls(self) -> tuple[str, ...]:
        """It pitches."""
        return ("pitch",)

    def sense(self, axis: str) -> float:
        """Forward is nose down."""
        return -1.0

    def mirrored(self) -> float | None:
        """It is in the middle."""
        return 1.0

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Also: the zero of its encoder."""
        offset = Uncertainty(
            name="offset_mm",
            unit="mm",
            certain=0.0,
            scale=1e-3,
            spread="uniform(-1, 1)",
            long_name=f"zero error of the encoder of the {self.name}",
            why="battery ahead of where it says; 0.3 mm pitch the Sea-Wing by 0.4 deg",
        )
        return (offset, *super().uncertainties())

    def energy(
        self,
        vehicle: Carrier,
        before: ArrayLike,
        after: ArrayLike,
        losses: Losses,
        *,
        depth: ArrayLike,
        pitch: ArrayLike,
        duration: ArrayLike,
    ) -> Array:
        """Lifting its mass along the pitched hull and against friction [J]."""
        weight = vehicle.moved_by(self.name).mass * vehicle.gravity
        moved = np.subtract(after, before)
        sliding = weight * (moved * np.sin(pitch) + losses.rail_friction * np.abs(moved))
        return np.maximum(sliding, 0.0) / losses.screw_efficiency

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Forward in a dive, aft in a climb."""
        return float(heavy * rng.uniform(*SHIFT) * (self.high / TRAVEL))
