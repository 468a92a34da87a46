"""Faults of the energy: a battery pack that is gone, a device that stays on."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

from twin.faults.base import Condition, Fault


@dataclasses.dataclass(frozen=True, kw_only=True)
class PackLost(Fault):
    """A battery pack that no longer gives: its fuse blew, or a cell died."""

    kind: ClassVar[str] = "pack_lost"
    says: ClassVar[str] = "a battery pack is lost"
    size_name: ClassVar[str] = "part"
    sizes: ClassVar[tuple[float, float]] = (0.2, 0.5)
    whole: ClassVar[bool] = False
    source: ClassVar[str] = "one pack of two to five in parallel"
    shows: ClassVar[str] = "a voltage that drops more under the pump's load, and falls faster"
    otherwise: ClassVar[str] = "cold batteries; a counter that lost its place"
    find_out: ClassVar[str] = "compare the voltage under load and at rest; plan for less energy"

    part: float = 0.33
    """of the batteries that is gone"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Fewer packs."""
        return condition.replace(packs=condition.packs * (1.0 - size))


@dataclasses.dataclass(frozen=True, kw_only=True)
class HotelRaised(Fault):
    """A device that stays on, or a leak of current."""

    kind: ClassVar[str] = "hotel_raised"
    says: ClassVar[str] = "the hotel load is raised"
    size_name: ClassVar[str] = "watts"
    unit: ClassVar[str] = "W"
    sizes: ClassVar[tuple[float, float]] = (0.2, 1.0)
    most: ClassVar[float] = 1000.0
    source: ClassVar[str] = "ours: a modem or a sensor that is not switched off"
    shows: ClassVar[str] = "more current while nothing moves"
    otherwise: ClassVar[str] = "a sensor that was switched on"
    find_out: ClassVar[str] = "switch devices off one by one and read the current"

    watts: float = 0.4
    """[W] taken all the time"""

    def change(self, condition: Condition, size: float) -> Condition:
        """More power of the electronics."""
        return condition.with_losses(hotel_power=condition.consumption.hotel_power + size)
