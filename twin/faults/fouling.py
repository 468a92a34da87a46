"""Fouling: what grows on hull and wings, a little every day."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

from twin.faults.base import Condition, Fault
from twin.vehicle.laws import FlowFrame

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

SPOILT = 0.3
"""Loss of lift slope over the gain of drag: roughness thickens the boundary layer of the wings"""
BELOW = 0.25
"""Place of what is attached below the axis, over the hull's diameter"""
HEAVY = 0.0004
"""Weight in water over the vehicle's for a drag that is doubled: barnacles of 20 g on 50 kg"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fouling(Fault):
    """Algae and barnacles: drag that grows from day to day, and lift that goes."""

    kind: ClassVar[str] = "fouling"
    says: ClassVar[str] = "growth on hull and wings"
    size_name: ClassVar[str] = "per_day"
    unit: ClassVar[str] = "d-1"
    sizes: ClassVar[tuple[float, float]] = (0.02, 0.08)
    grows: ClassVar[bool] = True
    source: ClassVar[str] = (
        "Haldeman and others, OCEANS 2016; Anderlini and others, IEEE JOE 2021: drag up to some "
        "times that of a clean hull after weeks, slower, more rudder, a little heavier or lighter"
    )
    shows: ClassVar[str] = "slower dives and climbs alike, more from day to day"
    otherwise: ClassVar[str] = "something attached, at once; a pump that moves less"
    find_out: ClassVar[str] = (
        "steepen the glide: drag at zero lift then costs less; look at it, or clean it"
    )

    per_day: float = 0.03
    """part of its drag that is added a day"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """The law must have a drag to grow."""
        return _without_drag(vehicle)

    def change(self, condition: Condition, size: float) -> Condition:
        """More drag, less lift, some weight."""
        vehicle = condition.vehicle
        law = vehicle.law.with_drag(1.0 + size)
        if isinstance(law, FlowFrame):
            lifts = 1.0 / (1.0 + SPOILT * size)
            law = dataclasses.replace(law, lift=(law.lift[0] * lifts, law.lift[1] * lifts))
        found = condition.with_vehicle(law=law)
        return found.with_mass(HEAVY * size * vehicle.mass, (0.0, 0.0, 0.0))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Attached(Fault):
    """Something towed or attached at once: weed, a line, a remora."""

    kind: ClassVar[str] = "attached"
    says: ClassVar[str] = "something is towed or attached"
    size_name: ClassVar[str] = "drag"
    sizes: ClassVar[tuple[float, float]] = (0.3, 1.5)
    most: ClassVar[float] = 10.0
    source: ClassVar[str] = (
        "Yang, Lembke, Zhang and Edwards, 2023 (arXiv 2308.00180): remoras and weed on Slocums, "
        "slow climbs and roll"
    )
    shows: ClassVar[str] = "slower dives and climbs from one dive on, nose down"
    otherwise: ClassVar[str] = "growth, from day to day; a pump that moves less"
    find_out: ClassVar[str] = "invert dives, pitch hard, wait: remoras leave; look at it"

    drag: float = 0.6
    """part of the vehicle's own drag that it adds"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """The law must have a drag."""
        return _without_drag(vehicle)

    def change(self, condition: Condition, size: float) -> Condition:
        """More drag, below the axis, so that it lowers the nose."""
        vehicle = condition.vehicle
        law = vehicle.law.with_drag(1.0 + size)
        if isinstance(law, FlowFrame) and isinstance(vehicle.law, FlowFrame):
            first, second, third = law.pitch_moment
            more = law.drag[0] - vehicle.law.drag[0]
            moment = first - more * BELOW * vehicle.hull_diameter
            law = dataclasses.replace(law, pitch_moment=(moment, second, third))
        return condition.with_vehicle(law=law)


def _without_drag(vehicle: Vehicle) -> str:
    if vehicle.law.with_drag(2.0) is not None:
        return ""
    return f"has the hull law {vehicle.law.kind!r}, whose drag is not one number"
