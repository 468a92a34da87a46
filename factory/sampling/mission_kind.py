"""Base of the kinds of drawn segments: what every kind says of itself."""

from __future__ import annotations

import math
from typing import ClassVar

from factory.sampling.distribution import Drawn, Parameter
from twin.mission import Segment
from twin.vehicle.vehicle import Vehicle


class MissionKind:
    """One kind of segment; `factory.sampling.profiles` has all of them."""

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
