"""What every kind of drawn segment says of itself.

The registry of the kinds of segments that the factory draws.
"""

from __future__ import annotations

import math
from typing import ClassVar

from factory import seams
from factory.sampling.distribution import Drawn, Parameter
from twin.errors import InputError
from twin.mission import Segment
from twin.registry import Registry, instance_of
from twin.vehicle.vehicle import Vehicle


class MissionKind:
    """One kind of segment; derive your own from it and register an object of it."""

    name: ClassVar[str] = ""
    """What `mission.kind` draws"""
    uses: ClassVar[tuple[str, ...]] = ()
    """Parameters of the table that it is made of, without their group `mission.`; those that a
    vehicle has not are left out"""

    def fits(self, vehicle: Vehicle) -> bool:
        """Whether a vehicle has the parts to fly it."""
        raise NotImplementedError

    def rows(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Rows of the table of parameters that this kind brings, each marked `per_segment`."""
        return ()

    def keep(self, drawn: Drawn) -> Drawn:
        """The draws of one segment without those that this kind does not use: they are NaN."""
        used = {"mission.kind", *(f"mission.{name}" for name in self.uses)}
        return {name: value if name in used else math.nan for name, value in drawn.items()}

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """Time [s] that it lasts at least; inf when it does not end by itself.

        Raises:
          MissionError: the vehicle cannot fly it.
        """
        raise NotImplementedError

    def deepest_m(self, drawn: Drawn) -> float:
        """Depth [m] that it goes to; 0 when it follows the sea floor or stays up."""
        return 0.0

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """What guidance flies, and the heading [deg true] after it.

        Raises:
          MissionError: its numbers are no segment.
        """
        raise NotImplementedError


def propelled(vehicle: Vehicle) -> bool:
    """Whether a propeller drives the vehicle: it flies surveys above a sea floor."""
    return vehicle.steered("speed") is not None


def keeps_level(vehicle: Vehicle) -> bool:
    """Whether it can hold a depth under its propeller, and turn to a heading there."""
    steered = (vehicle.steered(control) for control in ("speed", "pitch", "heading"))
    return vehicle.depth_pid is not None and all(part is not None for part in steered)


def survey_row(
    name: str, unit: str, paper: str, field: str, long_name: str, why: str = ""
) -> Parameter:
    """A row that is drawn for every segment."""
    return Parameter(f"mission.{name}", unit, paper, field, long_name, why, per_segment=True)


GROUP = "glider_twin.mission_kinds"
"""Entry points of installed distributions: NAME = "module:OBJECT"."""
NOUN = "kind of mission"
_is_kind = instance_of(NOUN, MissionKind)


def check_kind(name: str, kind: object) -> MissionKind:
    """The kind; raises InputError when it is only half there."""
    found = _is_kind(name, kind)
    for method in ("fits", "shortest_time", "segment"):
        if getattr(type(found), method) is getattr(MissionKind, method):
            raise InputError(f"{NOUN} {name!r} is only half there: it lacks the method {method!r}")
    return found


MISSION_KINDS: Registry[MissionKind] = seams.MISSION_KINDS
"""Every kind by name."""

register = MISSION_KINDS.add
"""Add a kind of one's own."""


def kinds_for(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the kinds that a vehicle can fly; stores keep their positions."""
    return tuple(name for name, kind in MISSION_KINDS.items() if kind.fits(vehicle))
