"""Transect: straight and level on a heading."""

from __future__ import annotations

from factory.recipe.drawn import Drawn, number
from factory.recipe.kinds.level import LevelKind
from twin.mission import Segment, Transect
from twin.vehicle.vehicle import Vehicle


class TransectKind(LevelKind):
    """A new heading for each, for a time."""

    name = "transect"
    uses = (*LevelKind.uses, "heading_change_deg", "segment_duration_s")

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """Its clock."""
        return number(drawn, "mission.segment_duration_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """A transect."""
        heading = (heading_deg + number(drawn, "mission.heading_change_deg")) % 360.0
        return (
            Transect(
                heading_deg=heading,
                duration_s=number(drawn, "mission.segment_duration_s"),
                **self.fields(drawn),
            ),
            heading,
        )


TRANSECT = TransectKind()
