"""Faults of the drives that pitch and turn a vehicle: one that stands, one that slips."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from twin.faults.base import Array, Condition, Fault

if TYPE_CHECKING:
    from twin.vehicle.parts import Part
    from twin.vehicle.vehicle import Vehicle

STANDS = 1e-9
"""of its rate that a drive keeps which no longer moves"""


def _turning(vehicle: Vehicle) -> Part | None:
    return vehicle.steered("heading")


@dataclasses.dataclass(frozen=True, kw_only=True)
class TurnStuck(Fault):
    """A roll or fin drive that stays where it is."""

    kind: ClassVar[str] = "turn_stuck"
    says: ClassVar[str] = "the roll or fin drive is stuck"
    size_name: ClassVar[str] = "part"
    source: ClassVar[str] = "it stands: no size"
    shows: ClassVar[str] = "a position that does not follow its command, circles"
    otherwise: ClassVar[str] = "its encoder alone: then it still holds its heading"
    find_out: ClassVar[str] = "command both ends at the surface and read position and current"

    part: float = 1.0
    """of its rate that is lost"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """It needs something that turns it."""
        return "" if _turning(vehicle) is not None else "has nothing that turns it"

    def expected(self, way: Array) -> Mapping[str, Array]:
        """It makes no way any more and holds its heading less well: by how much depends on the sea,
        which flights of the twin without waves do not have."""
        one = np.ones(len(way))
        return {"turn_moves": -5.0 * one, "heading_error": 3.0 * one}

    def change(self, condition: Condition, size: float) -> Condition:
        """A rate of next to nothing."""
        part = _turning(condition.vehicle)
        assert part is not None
        rate = part.rate * max(1.0 - size, STANDS)
        return condition.with_vehicle(**{part.name: {"rate": rate}})


@dataclasses.dataclass(frozen=True, kw_only=True)
class TurnSlips(Fault):
    """A roll or fin drive whose position is no longer what its encoder says."""

    kind: ClassVar[str] = "turn_slips"
    says: ClassVar[str] = "the roll or fin drive has slipped"
    size_name: ClassVar[str] = "degrees"
    unit: ClassVar[str] = "degree"
    sizes: ClassVar[tuple[float, float]] = (5.0, 15.0)
    signed: ClassVar[bool] = True
    most: ClassVar[float] = 90.0
    source: ClassVar[str] = "ours: some teeth of a gear, an eighth to a third of a rudder's travel"
    shows: ClassVar[str] = "another position of the drive, or another roll, at a straight heading"
    otherwise: ClassVar[str] = "a wing or weed on one side, which differs in dives and climbs"
    find_out: ClassVar[str] = "fly straight and read where the drive stands; recalibrate its zero"

    degrees: float = 8.0
    """[degree] from what the encoder says, positive as the part's own axis"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """It needs a turning part with an angle."""
        part = _turning(vehicle)
        return "" if part is not None and part.unit == "rad" else "has no angle that turns it"

    def change(self, condition: Condition, size: float) -> Condition:
        """Another zero of the encoder."""
        part = _turning(condition.vehicle)
        assert part is not None
        return _slipped(condition, part.name, math.radians(size))


@dataclasses.dataclass(frozen=True, kw_only=True)
class PitchSlips(Fault):
    """A pitch battery that is no longer where its encoder says."""

    kind: ClassVar[str] = "pitch_slips"
    says: ClassVar[str] = "the pitch battery has slipped"
    size_name: ClassVar[str] = "travel"
    sizes: ClassVar[tuple[float, float]] = (0.05, 0.2)
    signed: ClassVar[bool] = True
    source: ClassVar[str] = "ours: a loose nut, a twentieth to a fifth of the travel"
    shows: ClassVar[str] = "another battery position at the same pitch, in dives and climbs alike"
    otherwise: ClassVar[str] = "water that gathers at one end; another payload"
    find_out: ClassVar[str] = "drive it to both ends and read where they are; recalibrate its zero"

    travel: float = 0.1
    """of the part's travel that it lies further along than its encoder says"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """It needs a battery that slides."""
        part = vehicle.steered("pitch")
        return "" if part is not None and part.joint == "slide" else "has no battery that slides"

    def change(self, condition: Condition, size: float) -> Condition:
        """Another zero of the encoder."""
        part = condition.vehicle.steered("pitch")
        assert part is not None
        return _slipped(condition, part.name, size * (part.high - part.low))


def _slipped(condition: Condition, name: str, offset: float) -> Condition:
    zeros = {**condition.zeros, name: condition.zeros.get(name, 0.0) + offset}
    return condition.replace(zeros=zeros)
