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
"""[m] SHIFT: range of commands of a random manoeuvre, for a slide with this TRAVEL."""
ROTATION = 60.0
"""[deg] Largest rotation that a random manoeuvre samples."""


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
        """Pitch: the mass pitches the vehicle."""
        return ("pitch",)

    def sense(self, axis: str) -> float:
        """Sign -1: a mass moved forward pitches the nose down."""
        return -1.0

    def mirrored(self) -> float | None:
        """Factor 1: the mass slides on the hull's axis."""
        return 1.0

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Base uncertainties and the zero of the encoder."""
        offset = encoder_zero(
            self.name, name="offset_mm", unit="mm", scale=1e-3, spread="uniform(-1, 1)",
            why="battery ahead of where it says; 0.3 mm pitch the Sea-Wing by 0.4 deg",
        )  # fmt: skip
        return (offset, *super().uncertainties())

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Energy [J] of lifting the mass along the pitched hull and against friction."""
        weight = vehicle.moved_by(self.name).mass * vehicle.gravity
        moved = np.subtract(move.after, move.before)
        sliding = weight * (moved * np.sin(move.pitch) + losses.rail_friction * np.abs(moved))
        return np.maximum(sliding, 0.0) / losses.screw_efficiency

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Sample a place forward in a dive, aft in a climb."""
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
    """[rad] Position at which the mass hangs straight below the axis; at rest there, it steers a
    slightly uneven hull straight."""

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Field `NAME.neutral` [rad], 0 where the file has none."""
        return {"neutral": reader.number(f"{name}.neutral", default=0.0)}

    def values(self) -> tuple[float, ...]:
        """The neutral position [rad]."""
        return (self.neutral,)

    @property
    def rest(self) -> float:
        """Neutral position [rad], within the travel."""
        return min(max(self.neutral, self.low), self.high)

    def controls(self) -> tuple[str, ...]:
        """Heading: the rolled vehicle turns."""
        return ("heading",)

    def mirrored(self) -> float | None:
        """Factor -1: port becomes starboard; None unless the mass hangs straight at 0."""
        return None if self.neutral else -1.0

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Base uncertainties and the zero of the encoder."""
        return (turned_encoder(self.name, "battery"), *super().uncertainties())

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Energy [J] of raising the eccentric mass above its lowest place and of friction."""
        mass = vehicle.moved_by(self.name)
        before, after = (np.subtract(at, self.neutral) for at in (move.before, move.after))
        raised = mass.eccentricity * (np.cos(before) - np.cos(after))
        turning = mass.mass * vehicle.gravity * np.cos(move.pitch) * raised
        turning += losses.bearing_torque * np.abs(np.subtract(after, before))
        return np.maximum(turning, 0.0) / losses.screw_efficiency

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Sample a rotation; every second command on average is 0."""
        return float(math.radians(rng.uniform(-ROTATION, ROTATION)) * rng.integers(0, 2))
