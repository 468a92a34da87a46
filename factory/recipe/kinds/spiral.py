"""Spiral: dives and climbs that turn all the time."""

from __future__ import annotations

from factory.recipe.drawn import Drawn, number
from factory.recipe.kinds.profile import ProfileKind
from twin.mission import Segment, Spiral
from twin.vehicle.vehicle import Vehicle


class SpiralKind(ProfileKind):
    """At a fixed position of what turns the vehicle."""

    name = "spiral"
    uses = (*ProfileKind.uses, "rotation_deg")

    def fits(self, vehicle: Vehicle) -> bool:
        """Something must turn it."""
        return vehicle.steered("heading") is not None

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """A spiral; the next saw-tooth goes on from the heading before it."""
        rotation = number(drawn, "mission.rotation_deg")
        return Spiral(rotation_deg=rotation, **self.fields(drawn)), heading_deg


SPIRAL = SpiralKind()
