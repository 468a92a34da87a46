"""Battery hinge: a mass that turns about the hull's axis, rolls the vehicle and so turns it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from twin.vehicle.changes import Uncertainty
from twin.vehicle.parts.base import Array, Carrier, Losses, Part, Quantity

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

ROTATION = 60.0
"""[deg] largest rotation that a random manoeuvre draws"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class BatteryHinge(Part):
    """A mass below the hull's axis; a positive rotation puts it to port."""

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
        offset = Uncertainty(
            name="offset_deg",
            unit="degree",
            certain=0.0,
            scale=math.pi / 180.0,
            spread="uniform(-2, 2)",
            long_name=f"zero error of the encoder of the {self.name}",
            why="battery turned from where it says",
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
        """Raising its eccentric mass, which hangs lowest at 0, and friction [J]."""
        mass = vehicle.moved_by(self.name)
        before, after = np.subtract(before, self.neutral), np.subtract(after, self.neutral)
        raised = mass.eccentricity * (np.cos(before) - np.cos(after))
        turning = mass.mass * vehicle.gravity * np.cos(pitch) * raised
        turning += losses.bearing_torque * np.abs(np.subtract(after, before))
        return np.maximum(turning, 0.0) / losses.screw_efficiency

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Every other command is level."""
        return float(math.radians(rng.uniform(-ROTATION, ROTATION)) * rng.integers(0, 2))
