"""Pump and drop weight: the parts that make a vehicle light or heavy."""

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
"""[kg] Range of the magnitude of net mass that a random manoeuvre samples."""


@inline
def native_volume(values, position):  # type: ignore[no-untyped-def]
    """Volume [cm3] relative to the neutral position."""
    return position - values[0]


@scalar
def fossen_volume(values, position):  # type: ignore[no-untyped-def]
    """Volume [cm3] added to the neutral one."""
    return position - values[0]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Pump(Part):
    """A buoyancy engine; its position is the volume in its bladder, a larger one is lighter.

    The pump changes volume, not mass: oil leaves the pressure hull but stays on the vehicle.
    """

    kind: ClassVar[str] = "pump"
    unit: ClassVar[str] = "cm3"
    quantity: ClassVar[Quantity] = Quantity(
        unit="cm3", scale=1.0, long_name="pumped volume, more is lighter", limits=(-1e5, 1e5)
    )
    turn: ClassVar[int] = 10

    neutral: float = 0.0
    """[cm3] Position at which the vehicle displaces its neutral volume."""

    native_volume = staticmethod(native_volume)
    fossen_volume = staticmethod(fossen_volume)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Field `NAME.neutral` [cm3], 0 where the file has none."""
        return {"neutral": reader.number(f"{name}.neutral", default=0.0)}

    def values(self) -> tuple[float, ...]:
        """The neutral position [cm3]."""
        return (self.neutral,)

    def mirrored(self) -> float | None:
        """Factor 1: the pump has no side."""
        return 1.0

    def controls(self) -> tuple[str, ...]:
        """Buoyancy: the pump makes the vehicle heavy or light."""
        return ("buoyancy",)

    @property
    def failsafe(self) -> float:
        """Upper end of the travel, at which the vehicle rises."""
        return self.high

    @property
    def rest(self) -> float:
        """The neutral volume [cm3]."""
        return self.neutral

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Energy [J] of pumping out against the sea, and of letting in by `pump_return`."""
        pressure = vehicle.reference_density * vehicle.gravity * np.maximum(move.depth, 0.0)
        moved = np.subtract(move.after, move.before) * CUBIC_CM
        pumped, returned = np.maximum(moved, 0.0), np.maximum(-moved, 0.0)
        work = pumped * (pressure + losses.hull_vacuum) / losses.pump_efficiency
        return np.asarray(work + pumped * losses.pump_loss + returned * losses.pump_return)

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Sample a net mass, heavy in a dive and light in a climb, within the pump's reach."""
        most = abs(vehicle.pump_for_net_mass(NET_MASS[1]) - self.neutral)
        reach = min(1.0, (self.high - self.neutral) / most)
        return vehicle.pump_for_net_mass(heavy * rng.uniform(*NET_MASS) * reach)


@inline
def native_mass(values, position):  # type: ignore[no-untyped-def]
    """Missing mass [kg], at most 0: the hull's mass in the file includes the weight."""
    return -values[0] * (1.0 - position)


@scalar
def fossen_mass(values, position):  # type: ignore[no-untyped-def]
    """Mass [kg] relative to the file's, at most 0."""
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
    """[kg] Weight in water over gravity: mass minus displaced water. The hull's mass in the file
    includes this weight."""

    native_mass = staticmethod(native_mass)
    fossen_mass = staticmethod(fossen_mass)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Field `NAME.mass` [kg]."""
        return {"mass": reader.number(f"{name}.mass")}

    def problems(self) -> list[tuple[str, str]]:
        """Report also a mass of 0 or less and a travel other than 0 to 1."""
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
        """Factor 1: the weight has no side."""
        return 1.0

    @property
    def failsafe(self) -> float:
        """Position 0: the weight is released so that the vehicle rises."""
        return self.low

    @property
    def rest(self) -> float:
        """Position 1: the weight is held."""
        return 1.0

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Hold the weight: a released one could not come back."""
        return 1.0

    def text(self, value: float) -> str:
        """Text "held", "gone", or the fraction still held."""
        return {1.0: "held", 0.0: "gone"}.get(value, f"{value:.4g} held")

    def told(self, time: Array, positions: Array) -> dict[str, str]:
        """Summary row with the time at which the weight was released, if at all."""
        gone = np.flatnonzero(positions < 1.0)
        text = f"released at {time[gone[0]]:.0f} s" if gone.size else "held throughout"
        return {self.name: text}
