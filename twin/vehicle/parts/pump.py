"""Pump and drop weight: what makes a vehicle light or heavy."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from twin.compiled import inline
from twin.compiled.elementary import scalar
from twin.vehicle.parts.base import Array, Carrier, Losses, Move, Part, Quantity

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

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Pumping out against the sea [J]; letting in costs `pump_return`, 0 by default."""
        pressure = vehicle.reference_density * vehicle.gravity * np.maximum(move.depth, 0.0)
        moved = np.subtract(move.after, move.before) * CUBIC_CM
        pumped, returned = np.maximum(moved, 0.0), np.maximum(-moved, 0.0)
        work = pumped * (pressure + losses.hull_vacuum) / losses.pump_efficiency
        return np.asarray(work + pumped * losses.pump_loss + returned * losses.pump_return)

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Heavy or light, as far as it reaches."""
        most = abs(vehicle.pump_for_net_mass(NET_MASS[1]) - self.neutral)
        reach = min(1.0, (self.high - self.neutral) / most)
        return vehicle.pump_for_net_mass(heavy * rng.uniform(*NET_MASS) * reach)


@inline
def native_mass(values, position):  # type: ignore[no-untyped-def]
    """Mass [kg] that is missing, negative: the hull of the file carries the weight."""
    return -values[0] * (1.0 - position)


@scalar
def fossen_mass(values, position):  # type: ignore[no-untyped-def]
    """[kg] that the vehicle carries less than its file says."""
    return values[0] * (position - 1.0)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DropWeight(Part):
    """A weight of small volume under the hull; its position is 1 while held and 0 once gone."""

    kind: ClassVar[str] = "drop-weight"
    unit: ClassVar[str] = "1"
    quantity: ClassVar[Quantity] = Quantity(
        unit="1", scale=1.0, long_name="part still held", limits=(0.0, 1.0)
    )
    one_way: ClassVar[bool] = True
    turn: ClassVar[int] = 60

    mass: float
    """[kg] in water: its weight less that of the water it displaces, over gravity; part of the
    hull's mass in the file"""

    native_mass = staticmethod(native_mass)
    fossen_mass = staticmethod(fossen_mass)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """`NAME.mass` [kg]."""
        return {"mass": reader.number(f"{name}.mass")}

    def problems(self) -> list[tuple[str, str]]:
        """Also: a weight without weight, a travel that is not 0 to 1."""
        found = super().problems()
        if not self.mass > 0.0:
            found.append(("mass", "positive"))
        if (self.low, self.high) != (0.0, 1.0):
            found.append(("actrange", "'0 1'"))
        return found

    def values(self) -> tuple[float, ...]:
        """The mass [kg]."""
        return (self.mass,)

    def mirrored(self) -> float | None:
        """It has no side."""
        return 1.0

    @property
    def failsafe(self) -> float:
        """Let go, so that the vehicle rises."""
        return self.low

    @property
    def rest(self) -> float:
        """Held."""
        return 1.0

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Held: a manoeuvre comes back."""
        return 1.0

    def text(self, value: float) -> str:
        """Held, gone, or the part of it that is left."""
        return {1.0: "held", 0.0: "gone"}.get(value, f"{value:.4g} held")

    def told(self, time: Array, positions: Array) -> dict[str, str]:
        """When it was let go, if it was."""
        gone = np.flatnonzero(positions < 1.0)
        text = f"released at {time[gone[0]]:.0f} s" if gone.size else "held throughout"
        return {self.name: text}
