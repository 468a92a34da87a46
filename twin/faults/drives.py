"""Faults of drives and batteries: a stuck or slipped part, a weak pump, a lost pack."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from twin.faults.base import Array, Condition, Fault
from twin.vehicle.parts.pump import CUBIC_CM

if TYPE_CHECKING:
    from twin.vehicle.parts import Part
    from twin.vehicle.vehicle import Vehicle

STANDS = 1e-9
"""Fraction of its rate that a stuck drive keeps, so that the rate stays above 0."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class _DriveFault(Fault):
    """A fault of the part that steers one axis of a vehicle."""

    axis: ClassVar[str]
    """Axis, as an argument of `Vehicle.steered`."""
    missing: ClassVar[str]
    """Text that follows "has" in the reason for a vehicle without the part: "no pump"."""
    must: ClassVar[tuple[str, str] | None] = None
    """Attribute of the part and its required value."""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Reason if the vehicle lacks the part; empty otherwise."""
        drive = vehicle.steered(cls.axis)
        if drive is None or (cls.must and getattr(drive, cls.must[0]) != cls.must[1]):
            return f"has {cls.missing}"
        return ""

    def drive(self, condition: Condition) -> Part:
        """Part that has the fault."""
        drive = condition.vehicle.steered(self.axis)
        assert drive is not None
        return drive

    def slipped(self, condition: Condition, offset: float) -> Condition:
        """Return a copy whose encoder zero is shifted by `offset` in the part's unit."""
        zeros, name = condition.zeros, self.drive(condition).name
        return condition.replace(zeros={**zeros, name: zeros.get(name, 0.0) + offset})


@dataclasses.dataclass(frozen=True, kw_only=True)
class TurnStuck(_DriveFault):
    """A roll or fin drive that no longer moves."""

    kind = "turn_stuck"
    says = "the roll or fin drive is stuck"
    axis = "heading"
    missing = "nothing that turns it"
    size_name = "part"
    source = "it stands: no size"
    shows = "a position that does not follow its command, circles"
    otherwise = "its encoder alone: then it still holds its heading"
    find_out = "command both ends at the surface and read position and current"

    part: float = 1.0
    """Fraction of the drive's rate that is lost"""

    def expected(self, way: Array) -> Mapping[str, Array]:
        """Fewer moves and a larger heading error. Both numbers are rough: they depend on waves, and
        the twin's flights for health have none."""
        one = np.ones(len(way))
        return {"turn_moves": -5.0 * one, "heading_error": 3.0 * one}

    def change(self, condition: Condition, size: float) -> Condition:
        """Set the drive's rate to almost 0."""
        drive = self.drive(condition)
        return condition.with_vehicle(
            **{drive.name: {"rate": drive.rate * max(1.0 - size, STANDS)}}
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class TurnSlips(_DriveFault):
    """A roll or fin drive whose position differs from its encoder's reading."""

    kind = "turn_slips"
    says = "the roll or fin drive has slipped"
    axis = "heading"
    missing = "no angle that turns it"
    must = ("unit", "rad")
    size_name = "degrees"
    unit = "degree"
    sizes = (5.0, 15.0)
    signed = True
    most = 90.0
    source = "ours: some teeth of a gear, an eighth to a third of a rudder's travel"
    shows = "another position of the drive, or another roll, at a straight heading"
    otherwise = "a wing or weed on one side, which differs in dives and climbs"
    find_out = "fly straight and read where the drive stands; recalibrate its zero"

    degrees: float = 8.0
    """[degree] Difference from the encoder's reading, positive as the part's own axis"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Shift the zero of the encoder."""
        return self.slipped(condition, math.radians(size))


@dataclasses.dataclass(frozen=True, kw_only=True)
class PitchSlips(_DriveFault):
    """A pitch battery whose position differs from its encoder's reading."""

    kind = "pitch_slips"
    says = "the pitch battery has slipped"
    axis = "pitch"
    missing = "no battery that slides"
    must = ("joint", "slide")
    size_name = "travel"
    sizes = (0.05, 0.2)
    signed = True
    source = "ours: a loose nut, a twentieth to a fifth of the travel"
    shows = "another battery position at the same pitch, in dives and climbs alike"
    otherwise = "water that gathers at one end; another payload"
    find_out = "drive it to both ends and read where they are; recalibrate its zero"

    travel: float = 0.1
    """Distance ahead of the encoder's reading, as a fraction of the part's travel"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Shift the zero of the encoder."""
        drive = self.drive(condition)
        return self.slipped(condition, size * (drive.high - drive.low))


@dataclasses.dataclass(frozen=True, kw_only=True)
class PumpWeak(_DriveFault):
    """A worn pump, which is slower and needs more energy for the same volume."""

    kind = "pump_weak"
    says = "the pump is weak"
    axis = "buoyancy"
    missing = "no pump"
    size_name = "loss"
    sizes = (0.15, 0.5)
    whole = False
    source = "ours: from a motor's spread to a pump that hardly lifts its depth"
    shows = "fewer cm3 a second and more J a cm3 at depth"
    otherwise = "a low battery voltage; cold oil"
    find_out = "compare rate and power at equal depth and voltage; dive shallower"

    loss: float = 0.3
    """Fraction of the pump's rate and efficiency that is lost"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Lower the rate and efficiency."""
        pump, power, left = self.drive(condition), condition.consumption, 1.0 - size
        found = condition.with_vehicle(**{pump.name: {"rate": pump.rate * left}})
        return found.with_losses(
            pump_efficiency=power.pump_efficiency * left, pump_loss=power.pump_loss / left
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class PumpAir(_DriveFault):
    """Air in the oil: the encoder counts the air's volume, but the sea's pressure compresses it."""

    kind = "pump_air"
    says = "air in the pump's oil"
    axis = "buoyancy"
    missing = "no pump"
    size_name = "volume"
    unit = "cm3"
    sizes = (20.0, 80.0)
    most = 10000.0
    source = "ours: a tenth to a third of a shallow glider's pump"
    shows = "heavier below the surface than its pump says, and less work to pump"
    otherwise = "water in the hull, which goes on; fresher water"
    find_out = "compare buoyancy near the surface and below 50 m; bleed the oil"

    volume: float = 40.0
    """[cm3] Volume of the air at the surface; the volume vanishes at depth"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Reduce volume and pumping work as if the air had no volume (true below 10 m)."""
        pump = self.drive(condition)
        pumped = 1.0 - min(size / (pump.high - pump.low), 0.5)
        better = min(condition.consumption.pump_efficiency / pumped, 1.0)
        found = condition.replace(volume=condition.volume - size * CUBIC_CM)
        return found.with_losses(pump_efficiency=better)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PackLost(Fault):
    """A battery pack that no longer delivers: its fuse blew, or a cell died."""

    kind = "pack_lost"
    says = "a battery pack is lost"
    size_name = "part"
    sizes = (0.2, 0.5)
    whole = False
    source = "one pack of two to five in parallel"
    shows = "a voltage that drops more under the pump's load, and falls faster"
    otherwise = "cold batteries; a counter that lost its place"
    find_out = "compare the voltage under load and at rest; plan for less energy"

    part: float = 0.33
    """Fraction of the batteries that is lost"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Reduce the connected packs."""
        return condition.replace(packs=condition.packs * (1.0 - size))


@dataclasses.dataclass(frozen=True, kw_only=True)
class HotelRaised(Fault):
    """A device that stays on, or a leak of current."""

    kind = "hotel_raised"
    says = "the hotel load is raised"
    size_name = "watts"
    unit = "W"
    sizes = (0.2, 1.0)
    most = 1000.0
    source = "ours: a modem or a sensor that is not switched off"
    shows = "more current while nothing moves"
    otherwise = "a sensor that was switched on"
    find_out = "switch devices off one by one and read the current"

    watts: float = 0.4
    """[W] Additional power at all times"""

    def change(self, condition: Condition, size: float) -> Condition:
        """Raise the power of the electronics."""
        return condition.with_losses(hotel_power=condition.consumption.hotel_power + size)
