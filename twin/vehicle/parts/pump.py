"""Pump: a buoyancy engine that moves oil or water and so changes the displaced volume."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from twin.compiled import inline
from twin.compiled.elementary import scalar
from twin.vehicle.parts.base import Array, Carrier, Losses, Part, Quantity

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

CUBIC_CM = 1e-6  # [m3]
NET_MASS = (0.15, 0.45)
"""[kg] magnitude of the net buoyancy that a random manoeuvre draws"""


@inline
def native_volume(values, position):  # type: ignore[no-untyped-def]
    """Volume [cm3] above that at its neutral position."""
    return position - values[0]


@scalar
def fossen_volume(values, position):  # type: ignore[no-untyped-def]
    """Volume [cm3] that it adds to the neutral one."""
    return position - values[0]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Pump(Part):
    """A buoyancy engine; its position is the volume in its bladder, a larger one is lighter.

    It moves volume, not mass: oil leaves the pressure hull and stays on the vehicle.
    """

    kind: ClassVar[str] = "pump"
    unit: ClassVar[str] = "cm3"
    quantity: ClassVar[Quantity] = Quantity(
        unit="cm3", scale=1.0, long_name="pumped volume, more is lighter", limits=(-1e5, 1e5)
    )
    turn: ClassVar[int] = 10

    neutral: float = 0.0
    """[cm3] at which the vehicle displaces its neutral volume"""

    native_volume = staticmethod(native_volume)
    fossen_volume = staticmethod(fossen_volume)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """`NAME.neutral` [cm3], 0 when the file does not say."""
        return {"neutral": reader.number(f"{name}.neutral", default=0.0)}

    def values(self) -> tuple[float, ...]:
        """The neutral position [cm3]."""
        return (self.neutral,)

    def mirrored(self) -> float | None:
        """It has no side."""
        return 1.0

    def controls(self) -> tuple[str, ...]:
        """It makes the vehicle heavy or light."""
        return ("buoyancy",)

    @property
    def failsafe(self) -> float:
        """Full out, so that the vehicle rises."""
        return self.high

    @property
    def rest(self) -> float:
        """The neutral volume [cm3]."""
        return self.neutral

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
        """Pumping out against the sea [J]; letting in takes a valve and costs nothing."""
        pressure = vehicle.reference_density * vehicle.gravity * np.maximum(depth, 0.0)
        moved = np.subtract(after, before) * CUBIC_CM
        pumped, returned = np.maximum(moved, 0.0), np.maximum(-moved, 0.0)
        work = pumped * (pressure + losses.hull_vacuum) / losses.pump_efficiency
        return np.asarray(work + pumped * losses.pump_loss + returned * losses.pump_return)

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Heavy or light, as far as it reaches."""
        most = abs(vehicle.pump_for_net_mass(NET_MASS[1]) - self.neutral)
        reach = min(1.0, (self.high - self.neutral) / most)
        return vehicle.pump_for_net_mass(heavy * rng.uniform(*NET_MASS) * reach)
