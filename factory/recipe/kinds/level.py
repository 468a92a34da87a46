"""Level: motion at a depth or at an altitude, what transects, circles and lawn-mowers share."""

from __future__ import annotations

import math
from typing import ClassVar

from factory.recipe.drawn import Drawn, number
from factory.recipe.kinds.base import MissionKind, keeps_level, survey_row
from factory.recipe.parameter import Parameter
from twin.errors import InputError
from twin.vehicle.vehicle import Vehicle

DEPTH, ALTITUDE = "depth", "altitude"
SHALLOWEST_FLOOR_M = 25.0
"""[m] The sea floor of a survey is cut off here; the depths and altitudes below keep clear of it"""
_ROWS = (
    survey_row("level_by", "1", f"choice({DEPTH}: 2, {ALTITUDE}: 1)",
               f"choice({DEPTH}, {ALTITUDE})", "quantity that a level segment holds"),
    survey_row("depth_m", "m", "uniform(4, 16)", "uniform(4, 16)",
               "depth of a level segment", f"the sea is {SHALLOWEST_FLOOR_M:g} m deep or more"),
    survey_row("altitude_m", "m", "uniform(8, 18)", "uniform(8, 18)",
               "height of a level segment above the sea floor"),
)  # fmt: skip


class LevelKind(MissionKind):
    """At a depth or an altitude, at a speed."""

    uses: ClassVar[tuple[str, ...]] = (
        "level_by",
        "depth_m",
        "altitude_m",
        "min_altitude_m",
        "speed_m_s",
    )

    def fits(self, vehicle: Vehicle) -> bool:
        """A propeller, and what pitches and turns it."""
        return keeps_level(vehicle)

    def rows(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Depth, altitude, and which of them."""
        return _ROWS

    def keep(self, drawn: Drawn) -> Drawn:
        """With one of depth and altitude; raises InputError for another word."""
        other = {DEPTH: "mission.altitude_m", ALTITUDE: "mission.depth_m"}
        by = drawn["mission.level_by"]
        if by not in other:
            raise InputError(f"mission.level_by = {by}: choose among {DEPTH} and {ALTITUDE}")
        return {**super().keep(drawn), other[str(by)]: math.nan}

    def deepest_m(self, drawn: Drawn) -> float:
        """Its depth."""
        depth = number(drawn, "mission.depth_m")
        return 0.0 if math.isnan(depth) else depth

    def fields(self, drawn: Drawn) -> dict[str, float]:
        """Depth or altitude, and the speed."""
        held = "depth_m" if drawn["mission.level_by"] == DEPTH else "altitude_m"
        names = (held, "min_altitude_m", "speed_m_s")
        return {name: number(drawn, f"mission.{name}") for name in names}
