"""Faults of the buoyancy engine: it moves oil slowly, or air with it."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

from twin.faults.base import Condition, Fault
from twin.vehicle.parts.pump import CUBIC_CM

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle


def _without_pump(vehicle: Vehicle) -> str:
    return "" if vehicle.steered("buoyancy") is not None else "has no pump"


@dataclasses.dataclass(frozen=True, kw_only=True)
class PumpWeak(Fault):
    """A worn pump: slower, and more energy for the same volume."""

    kind: ClassVar[str] = "pump_weak"
    says: ClassVar[str] = "the pump is weak"
    size_name: ClassVar[str] = "loss"
    sizes: ClassVar[tuple[float, float]] = (0.15, 0.5)
    whole: ClassVar[bool] = False
    source: ClassVar[str] = "ours: from a motor's spread to a pump that hardly lifts its depth"
    shows: ClassVar[str] = "fewer cm3 a second and more J a cm3 at depth"
    otherwise: ClassVar[str] = "a low battery voltage; cold oil"
    find_out: ClassVar[str] = "compare rate and power at equal depth and voltage; dive shallower"

    loss: float = 0.3
    """part of its rate and of its efficiency that is lost"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """It needs a pump."""
        return _without_pump(vehicle)

    def change(self, condition: Condition, size: float) -> Condition:
        """A lower rate and efficiency."""
        pump = condition.vehicle.steered("buoyancy")
        assert pump is not None
        found = condition.with_vehicle(**{pump.name: {"rate": pump.rate * (1.0 - size)}})
        return found.with_losses(
            pump_efficiency=condition.consumption.pump_efficiency * (1.0 - size),
            pump_loss=condition.consumption.pump_loss / (1.0 - size),
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class PumpAir(Fault):
    """Air in the oil: a volume that the encoder counts and the sea takes back."""

    kind: ClassVar[str] = "pump_air"
    says: ClassVar[str] = "air in the pump's oil"
    size_name: ClassVar[str] = "volume"
    unit: ClassVar[str] = "cm3"
    sizes: ClassVar[tuple[float, float]] = (20.0, 80.0)
    most: ClassVar[float] = 10000.0
    source: ClassVar[str] = "ours: a tenth to a third of a shallow glider's pump"
    shows: ClassVar[str] = "heavier below the surface than its pump says, and less work to pump"
    otherwise: ClassVar[str] = "water in the hull, which goes on; fresher water"
    find_out: ClassVar[str] = "compare buoyancy near the surface and below 50 m; bleed the oil"

    volume: float = 40.0
    """[cm3] of air at the surface, nothing at depth"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """It needs a pump."""
        return _without_pump(vehicle)

    def change(self, condition: Condition, size: float) -> Condition:
        """The volume is missing at every depth below the first ten metres, where it is flown; and
        the work of pumping it is."""
        pump = condition.vehicle.steered("buoyancy")
        assert pump is not None
        pumped = 1.0 - min(size / (pump.high - pump.low), 0.5)
        better = min(condition.consumption.pump_efficiency / pumped, 1.0)
        found = condition.replace(volume=condition.volume - size * CUBIC_CM)
        return found.with_losses(pump_efficiency=better)
