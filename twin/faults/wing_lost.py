"""Wing lost: one wing or both have come off."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from twin.errors import unknown_name
from twin.faults.base import Condition, Fault
from twin.vehicle.laws.flow_frame import is_flow_frame

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

SIDES = {"port": (-1.0,), "starboard": (1.0,), "both": (-1.0, 1.0)}
"""Side of each wing that is lost, to starboard positive"""
BODY_LIFT = 0.25
"""Part of the lift that the hull and tail keep without wings: gliders' wings have three quarters of
it (Graver 2005, table 5.3, a Slocum's wings against its hull)"""
WING_DRAG = 0.2
"""Part of the drag at zero lift that the wings have: their wetted surface over the whole one's"""
SPAN = 0.2
"""Lever of a wing's forces and weight over the hull's length: the middle of a wing of 0.4 m on a
hull of 1.8 m, with the hull's radius"""
MISSED = 0.5
"""Part of a wing without which pictures leave it out"""
HEAVY = 0.0008
"""Weight of one wing in water over the vehicle's: 0.04 kg of 54, ours"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class WingLost(Fault):
    """A wing that broke or came off its rail."""

    kind: ClassVar[str] = "wing_lost"
    says: ClassVar[str] = "a wing is lost"
    size_name: ClassVar[str] = "part"
    source: ClassVar[str] = (
        "Anderlini and others, OCEANS 2020: two Slocums lost a wing unnoticed; they became lighter "
        "and rolled to its side, in dives otherwise than in climbs"
    )
    shows: ClassVar[str] = "roll that differs between dives and climbs, buoyancy, depth rate"
    otherwise: ClassVar[str] = "something that hangs on one side"
    find_out: ClassVar[str] = (
        "compare roll in dives and climbs; fly two dives on opposite headings; look at it when "
        "it is at the surface"
    )

    side: str = "port"
    """port, starboard or both"""
    part: float = 1.0
    """of the wing that is gone"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Only a hull law with wings' lift loses some."""
        if not is_flow_frame(vehicle.law) or vehicle.steered("buoyancy") is None:
            return "is no glider whose hull law has the lift of wings (flow-frame)"
        return ""

    def problems(self) -> list[str]:
        """A side."""
        return [] if self.side in SIDES else [unknown_name("side", self.side, SIDES)]

    def change(self, condition: Condition, size: float) -> Condition:
        """Less lift and drag, a wing's weight less, and forces that no longer balance."""
        vehicle = condition.vehicle
        law, sides = vehicle.flow_frame, SIDES[self.side]
        gone = 0.5 * size * len(sides)
        lifts = 1.0 - gone * (1.0 - BODY_LIFT)
        lever = SPAN * vehicle.hull_length
        # of the wings that are left: sum over sides of what each had, at its side
        torn = 0.5 * size * sum(sides)
        roll = torn * (1.0 - BODY_LIFT) * law.lift[1] * lever
        yaw = -torn * WING_DRAG * law.drag[0] * lever
        found = condition.with_vehicle(
            lift=(law.lift[0] * lifts, law.lift[1] * lifts),
            drag=(law.drag[0] * (1.0 - gone * WING_DRAG), law.drag[1] * lifts),
            roll_moment_lift=(law.roll_moment_lift[0] * lifts,),
            yaw_moment_lift=(law.yaw_moment_lift[0] * lifts,),
            side_force_lift=(law.side_force_lift[0] * lifts,),
            roll_moment=(law.roll_moment[0], law.roll_moment[1] * lifts),
            roll_from_yaw=(law.roll_from_yaw[0], law.roll_from_yaw[1] * lifts),
            yaw_from_roll=(law.yaw_from_roll[0], law.yaw_from_roll[1] * lifts),
            wing_asymmetry=(law.wing_asymmetry[0] + roll,),
            yaw_moment_offset=(law.yaw_moment_offset[0] + yaw,),
        )
        for side in sides:
            weight = -HEAVY * size * vehicle.mass
            found = found.with_mass(weight, (0.0, side * lever, 0.0))
        return found

    @property
    def gone(self) -> tuple[str, ...]:
        """The wing, where most of it is."""
        sides = ("port", "starboard") if self.side == "both" else (self.side,)
        return tuple(f"wing_{side}" for side in sides) if self.part >= MISSED else ()

    def choices(self, vehicle: Vehicle) -> tuple[Mapping[str, Any], ...]:
        """Port, starboard, both."""
        return tuple({"side": side} for side in SIDES)
