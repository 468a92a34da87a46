"""Lawn-mower: parallel legs to and fro that cover an area."""

from __future__ import annotations

from factory.recipe.drawn import Drawn, number
from factory.recipe.kinds.base import survey_row
from factory.recipe.kinds.level import LevelKind
from factory.recipe.parameter import Parameter
from twin.mission import LawnMower, Segment
from twin.vehicle.vehicle import Vehicle

_SPACING = "uniform(-160, 160) except (-80, 80)"
_ROWS = (
    survey_row("leg_length_m", "m", "uniform(150, 500)", "uniform(150, 500)",
               "length of a leg of the lawn-mower"),
    survey_row("spacing_m", "m", _SPACING, _SPACING,
               "spacing of the lawn-mower's legs",
               "positive to starboard; two turning circles fit in"),
    survey_row("legs", "1", "choice(3, 4, 5, 6)", "choice(3, 4, 5, 6)",
               "number of legs of the lawn-mower"),
)  # fmt: skip


class LawnMowerKind(LevelKind):
    """Legs at a depth or an altitude."""

    name = "lawn-mower"
    uses = (*LevelKind.uses, "heading_change_deg", "leg_length_m", "spacing_m", "legs")

    def rows(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Those of level segments, and of the legs."""
        return (*super().rows(vehicle), *_ROWS)

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """Its legs at its speed."""
        way = number(drawn, "mission.legs") * number(drawn, "mission.leg_length_m")
        return way / number(drawn, "mission.speed_m_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """A lawn-mower, its legs on a new heading."""
        heading = (heading_deg + number(drawn, "mission.heading_change_deg")) % 360.0
        return (
            LawnMower(
                heading_deg=heading,
                leg_length_m=number(drawn, "mission.leg_length_m"),
                spacing_m=number(drawn, "mission.spacing_m"),
                legs=number(drawn, "mission.legs"),
                **self.fields(drawn),
            ),
            heading,
        )


LAWN_MOWER = LawnMowerKind()
