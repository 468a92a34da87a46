"""Lawn-mower: a survey of parallel legs, as transects one after the other."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

from twin.mission import mission_file as check
from twin.mission.segments.level import Level
from twin.mission.segments.transect import Transect
from twin.vehicle.vehicle import Vehicle

MOST_LEGS = 10_000
"""Legs of a survey: each is a row of the table that guidance flies."""


@dataclass(frozen=True, kw_only=True)
class LawnMower(Level):
    """Parallel legs there and back with short ways across, at a depth or above the sea floor.

    Guidance counts every leg and every way across as a segment of its own.
    """

    kind: ClassVar[str] = "lawn-mower"

    heading_deg: float
    """Heading of the first leg [deg true]; the second comes back."""
    leg_length_m: float
    """Length of a leg through the water [m]."""
    spacing_m: float
    """Distance between legs [m]: positive moves to starboard of the first leg, negative to port."""
    legs: float
    """Number of legs."""

    def __post_init__(self) -> None:
        super().__post_init__()
        kind = self.kind
        check.heading(kind, "heading_deg", self.heading_deg)
        check.limit(kind, "leg_length_m", self.leg_length_m, "m")
        if not abs(check.number(kind, "spacing_m", self.spacing_m)) > 0.0:
            check.fail(kind, "spacing_m", self.spacing_m, "a distance, positive to starboard")
        check.within(kind, "legs", self.legs, "", 1, MOST_LEGS)
        if self.legs % 1:
            check.fail(kind, "legs", self.legs, "a whole number")

    def flown_as(self) -> tuple[Transect, ...]:
        """Its legs and the ways across, in order."""
        level = {f.name: getattr(self, f.name) for f in dataclasses.fields(Level)}
        across = self.heading_deg + (90.0 if self.spacing_m > 0.0 else -90.0)
        parts: list[Transect] = []
        for leg in range(int(self.legs)):
            if leg:
                parts.append(_transect(level, across, abs(self.spacing_m)))
            parts.append(_transect(level, self.heading_deg + 180.0 * (leg % 2), self.leg_length_m))
        return tuple(parts)

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """All its ways."""
        times = [part.expected(vehicle, depth, label)[0] for part in self.flown_as()]
        return sum(times), self.deepest(depth)


def _transect(level: dict[str, float | None], heading_deg: float, length_m: float) -> Transect:
    return Transect(heading_deg=heading_deg % 360.0, length_m=length_m, **level)  # type: ignore[arg-type]
