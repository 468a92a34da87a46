"""Faults of the hull, its wings and its propeller: losses, growth, attached objects, leaks."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from twin.errors import unknown_name
from twin.faults.base import Condition, Fault
from twin.vehicle.laws import FlowFrame
from twin.vehicle.laws.flow_frame import is_flow_frame
from twin.vehicle.parts.propeller import Propeller

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

SIDES = {"port": (-1.0,), "starboard": (1.0,), "both": (-1.0, 1.0)}
"""Sides of the lost wings: -1 is port, +1 is starboard."""
BODY_LIFT = 0.25
"""Fraction of the lift that hull and tail keep without wings: gliders' wings have three quarters
(Graver 2005, table 5.3, a Slocum's wings against its hull)."""
WING_DRAG = 0.2
"""Fraction of the zero-lift drag that the wings have: their fraction of the wetted surface."""
SPAN = 0.2
"""Lever of a wing's forces and weight, as a fraction of the hull's length. The middle of a wing of
0.4 m beside a hull of 1.8 m is at 0.3 m, hull radius included: 0.17, rounded up."""
LEAST_VISIBLE_LOSS = 0.5
"""Smallest lost fraction of a wing at which pictures leave the wing out."""
WING_WEIGHT = 0.0008
"""Weight of one wing in water, as a fraction of the vehicle's: 0.04 kg of 54, our estimate."""
LIFT_LOSS = 0.3
"""Relative loss of lift slope per relative gain of drag: roughness thickens the boundary layer."""
OBJECT_DEPTH = 0.25
"""Distance of an attached object below the axis, in hull diameters."""
GROWTH_WEIGHT = 0.0004
"""Weight in water of growth that doubles the drag, relative to the vehicle's: 20 g on 50 kg."""
LITRE = 1e-3
"""[m3] Volume of one litre."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class WingLost(Fault):
    """A wing that broke or came off its rail."""

    kind = "wing_lost"
    says = "a wing is lost"
    size_name = "part"
    source = (
        "Anderlini and others, OCEANS 2020: two Slocums lost a wing unnoticed; they became lighter "
        "and rolled to its side, in dives otherwise than in climbs"
    )
    shows = "roll that differs between dives and climbs, buoyancy, depth rate"
    otherwise = "something that hangs on one side"
    find_out = (
        "compare roll in dives and climbs; fly two dives on opposite headings; look at it when "
        "it is at the surface"
    )

    side: str = "port"
    """Lost wing: port, starboard or both"""
    part: float = 1.0
    """Fraction of the wing that is lost"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Reason if the hull law has no lift of wings or the pump is missing; empty otherwise."""
        if not is_flow_frame(vehicle.law) or vehicle.steered("buoyancy") is None:
            return "is no glider whose hull law has the lift of wings (flow-frame)"
        return ""

    def problems(self) -> list[str]:
        """Problem of a side that does not exist, in a list; empty otherwise."""
        return [] if self.side in SIDES else [unknown_name("side", self.side, SIDES)]

    def change(self, condition: Condition, size: float) -> Condition:
        """Reduce lift, drag and weight, and add the moments of the unbalanced forces."""
        vehicle = condition.vehicle
        law, sides = vehicle.flow_frame, SIDES[self.side]
        gone = 0.5 * size * len(sides)
        lifts = 1.0 - gone * (1.0 - BODY_LIFT)
        lever = SPAN * vehicle.hull_length
        # moments of the remaining lift and drag: the lost fraction of each wing, signed by its side
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
            weight = -WING_WEIGHT * size * vehicle.mass
            found = found.with_mass(weight, (0.0, side * lever, 0.0))
        return found

    @property
    def gone(self) -> tuple[str, ...]:
        """Prefix of the lost wing's geoms, if most of the wing is lost."""
        sides = ("port", "starboard") if self.side == "both" else (self.side,)
        return tuple(f"wing_{side}" for side in sides) if self.part >= LEAST_VISIBLE_LOSS else ()

    def choices(self, vehicle: Vehicle) -> tuple[Mapping[str, Any], ...]:
        """Port, starboard, both."""
        return tuple({"side": side} for side in SIDES)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _DragFault(Fault):
    """A fault that adds drag."""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Reason if the hull law cannot scale its drag; empty otherwise."""
        if vehicle.law.with_drag(2.0) is not None:
            return ""
        return f"has the hull law {vehicle.law.kind!r}, whose drag is not one number"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fouling(_DragFault):
    """Algae and barnacles: drag that grows from day to day, and less lift."""

    kind = "fouling"
    says = "growth on hull and wings"
    size_name = "per_day"
    unit = "d-1"
    sizes = (0.02, 0.08)
    grows = True
    source = (
        "Haldeman and others, OCEANS 2016; Anderlini and others, IEEE JOE 2021: drag up to some "
        "times that of a clean hull after weeks, slower, more rudder, a little heavier or lighter"
    )
    shows = "slower dives and climbs alike, more from day to day"
    otherwise = "something attached, at once; a pump that moves less"
    find_out = "steepen the glide: drag at zero lift then costs less; look at it, or clean it"

    per_day: float = 0.03
    """Growth of the drag per day, as a fraction of the clean drag"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Add drag and some weight, and reduce lift."""
        vehicle = condition.vehicle
        law = vehicle.law.with_drag(1.0 + size)
        if isinstance(law, FlowFrame):
            lifts = 1.0 / (1.0 + LIFT_LOSS * size)
            law = dataclasses.replace(law, lift=(law.lift[0] * lifts, law.lift[1] * lifts))
        found = condition.with_vehicle(law=law)
        return found.with_mass(GROWTH_WEIGHT * size * vehicle.mass, (0.0, 0.0, 0.0))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Attached(_DragFault):
    """Something towed or attached at once: weed, a line, a remora."""

    kind = "attached"
    says = "something is towed or attached"
    size_name = "drag"
    sizes = (0.3, 1.5)
    most = 10.0
    source = (
        "Yang, Lembke, Zhang and Edwards, 2023 (arXiv 2308.00180): remoras and weed on Slocums, "
        "slow climbs and roll"
    )
    shows = "slower dives and climbs from one dive on, nose down"
    otherwise = "growth, from day to day; a pump that moves less"
    find_out = "invert dives, pitch hard, wait: remoras leave; look at it"

    drag: float = 0.6
    """Added drag, as a fraction of the vehicle's own"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Add drag below the axis, which lowers the nose."""
        vehicle = condition.vehicle
        law = vehicle.law.with_drag(1.0 + size)
        if isinstance(law, FlowFrame) and isinstance(vehicle.law, FlowFrame):
            first, second, third = law.pitch_moment
            more = law.drag[0] - vehicle.law.drag[0]
            moment = first - more * OBJECT_DEPTH * vehicle.hull_diameter
            law = dataclasses.replace(law, pitch_moment=(moment, second, third))
        return condition.with_vehicle(law=law)


@dataclasses.dataclass(frozen=True, kw_only=True)
class WaterTaken(Fault):
    """A seal that leaks a little water all the time."""

    kind = "water_taken"
    says = "water in the hull"
    size_name = "per_day"
    unit = "L d-1"
    sizes = (0.02, 0.08)
    grows = True
    most = 10.0
    source = "ours: from what a pump's reach of 0.2 L hides for ten days to what it hides for two"
    shows = "faster dives, slower climbs, less vacuum, trim by the bow or stern"
    otherwise = "fresher or warmer water; air in the oil; the hull's temperature"
    find_out = "read the leak detectors and the vacuum at equal temperature; recover"

    per_day: float = 0.04
    """[L] Water taken in per day"""
    place: float = -0.25
    """Place of the water, positive forward of the middle, in hull lengths"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Reason if the vehicle has no pump to compensate the water's weight; empty otherwise."""
        return "" if vehicle.steered("buoyancy") is not None else "has no pump to trim against it"

    def problems(self) -> list[str]:
        """Problem of a place outside the hull, in a list; empty otherwise."""
        if not -0.5 <= self.place <= 0.5:
            return [f"place = {self.place:g} must lie within -0.5 and 0.5"]
        return []

    def change(self, condition: Condition, size: float) -> Condition:
        """Add a mass low in the hull without displacement."""
        vehicle = condition.vehicle
        at = (self.place * vehicle.hull_length, 0.0, 0.4 * vehicle.hull_diameter)
        mass = size * LITRE * vehicle.reference_density
        return condition.with_mass(mass, at).replace(taken=condition.taken + size * LITRE)


@dataclasses.dataclass(frozen=True, kw_only=True)
class BladeLost(Fault):
    """A propeller that lost a blade: less thrust and torque."""

    kind = "blade_lost"
    says = "a propeller blade is lost"
    size_name = "part"
    sizes = (0.33, 0.5)
    whole = False
    source = "one blade of three, or of two"
    shows = "slower at the same rate, with less power"
    otherwise = "growth on the hull, which takes more power, not less"
    find_out = "compare speed and power at the same rate; look at it"

    part: float = 0.33
    """Fraction of the blades that is lost"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Reason if the vehicle has no propeller; empty otherwise."""
        if isinstance(vehicle.steered("speed"), Propeller):
            return ""
        return "has no propeller that drives it"

    def change(self, condition: Condition, size: float) -> Condition:
        """Reduce thrust, torque and standing drag to those of the remaining blades."""
        screw = condition.vehicle.steered("speed")
        assert isinstance(screw, Propeller)
        left = 1.0 - size
        names = ("thrust_coefficient", "torque_coefficient", "standing_drag", "standing_torque")
        changes = {name: getattr(screw, name) * left for name in names}
        return condition.with_vehicle(**{screw.name: changes})
