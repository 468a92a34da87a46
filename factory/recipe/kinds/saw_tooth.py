"""Saw-tooth: dives and climbs on a heading, also called yo-yo."""

from __future__ import annotations

from factory.recipe.drawn import Drawn, number
from factory.recipe.kinds.profile import ProfileKind
from twin.mission import SawTooth, Segment
from twin.vehicle.vehicle import Vehicle


class SawToothKind(ProfileKind):
    """A new heading for each, where something turns the vehicle."""

    name = "saw-tooth"
    uses = (*ProfileKind.uses, "heading_change_deg")

    def fits(self, vehicle: Vehicle) -> bool:
        """Every vehicle dives and climbs."""
        return True

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """A saw-tooth."""
        if vehicle.steered("heading"):
            change = number(drawn, "mission.heading_change_deg")
            heading_deg = (heading_deg + change) % 360.0
        return SawTooth(heading_deg=heading_deg, **self.fields(drawn)), heading_deg


SAW_TOOTH = SawToothKind()
