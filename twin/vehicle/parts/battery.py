"""Battery slide and hinge: a mass that moves along the hull or turns about it, and so steers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from twin.vehicle.changes import Uncertainty, encoder_zero, turned_encoder
from twin.vehicle.parts.base import Array, Carrier, Losses, Move, Part, Quantity

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

SHIFT, TRAVEL = (0.008, 0.03), 0.05
"""[m] commands that a random manoeuvre draws, of a slide with such a travel [m]"""
ROTATION = 60.0
"""[deg] largest rotation that a random manoeuvre draws"""


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
        offset = encoder_zero(
            self.name, name="offset_mm", unit="mm", scale=1e-3, spread="uniform(-1, 1)",
            why="battery ahead of where it says; 0.3 mm pitch the Sea-Wing by 0.4 deg",
        )  # fmt: skip
        return (offset, *super().uncertainties())

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Lifting its mass along the pitched hull and against friction [J]."""
        weight = vehicle.moved_by(self.name).mass * vehicle.gravity
        moved = np.subtract(move.after, move.before)
        sliding = weight * (moved * np.sin(move.pitch) + losses.rail_friction * np.abs(moved))
        return np.maximum(sliding, 0.0) / losses.screw_efficiency

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Forward in a dive, aft in a climb."""
        return float(heavy * rng.uniform(*SHIFT) * (self.high / TRAVEL))


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class BatteryHinge(Part):
    """A mass below the hull's axis, which rolls it; a positive rotation puts the mass to port."""

    kind: ClassVar[str] = "battery-hinge"
    physics: ClassVar[int] = 5
    unit: ClassVar[str] = "rad"
    quantity: ClassVar[Quantity] = Quantity(
        unit="degree",
        scale=180.0 / np.pi,
        long_name="rotation about the hull, to port positive",
        limits=(-360.0, 360.0),
    )
    joint: ClassVar[str | None] = "hinge"
    turn: ClassVar[int] = 30

    neutral: float = 0.0
    """[rad] position at which the mass hangs straight below the axis: there it steers a hull
    straight that is not quite even"""

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """`NAME.neutral` [rad], 0 when the file does not say."""
        return {"neutral": reader.number(f"{name}.neutral", default=0.0)}

    def values(self) -> tuple[float, ...]:
        """The neutral position [rad]."""
        return (self.neutral,)

    @property
    def rest(self) -> float:
        """The neutral position."""
        return min(max(self.neutral, self.low), self.high)

    def controls(self) -> tuple[str, ...]:
        """It turns."""
        return ("heading",)

    def mirrored(self) -> float | None:
        """Port becomes starboard, of a mass that hangs straight at 0."""
        return None if self.neutral else -1.0

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Also: the zero of its encoder."""
        return (turned_encoder(self.name, "battery"), *super().uncertainties())

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Raising its eccentric mass, which hangs lowest at 0, and friction [J]."""
        mass = vehicle.moved_by(self.name)
        before, after = (np.subtract(at, self.neutral) for at in (move.before, move.after))
        raised = mass.eccentricity * (np.cos(before) - np.cos(after))
        turning = mass.mass * vehicle.gravity * np.cos(move.pitch) * raised
        turning += losses.bearing_torque * np.abs(np.subtract(after, before))
        return np.maximum(turning, 0.0) / losses.screw_efficiency

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Every other command is level."""
        return float(math.radians(rng.uniform(-ROTATION, ROTATION)) * rng.integers(0, 2))
