"""Circle: level turns of one radius."""

from __future__ import annotations

import math

from factory.recipe.drawn import Drawn, number
from factory.recipe.kinds.base import survey_row
from factory.recipe.kinds.level import LevelKind
from factory.recipe.parameter import Parameter
from twin.mission import Circle, Segment
from twin.vehicle.vehicle import Vehicle

_RADIUS = "uniform(-150, 150) except (-50, 50)"
_ROWS = (
    survey_row("radius_m", "m", _RADIUS, _RADIUS, "radius of the circle", "positive to starboard"),
    survey_row("turns", "1", "uniform(1, 4)", "uniform(1, 4)", "number of turns of the circle"),
)


class CircleKind(LevelKind):
    """Some turns at a depth or an altitude."""

    name = "circle"
    uses = (*LevelKind.uses, "radius_m", "turns")

    def rows(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Those of level segments, radius and turns."""
        return (*super().rows(vehicle), *_ROWS)

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """Its way at its speed."""
        around = 2.0 * math.pi * abs(number(drawn, "mission.radius_m"))
        return around * number(drawn, "mission.turns") / number(drawn, "mission.speed_m_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """A circle; the next heading is drawn from the one before it."""
        radius, turns = (number(drawn, f"mission.{name}") for name in ("radius_m", "turns"))
        return Circle(radius_m=radius, turns=turns, **self.fields(drawn)), heading_deg


CIRCLE = CircleKind()
