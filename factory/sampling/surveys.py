"""Transect: straight and level on a heading.

Lawn-mower: parallel legs to and fro that cover an area.
Level: motion at a depth or at an altitude, what transects, circles and lawn-mowers share.
Surface: a stay at the surface for a GPS fix. It is not drawn among the kinds: `surface_every`
says after how many of the others it comes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import ClassVar

from factory.sampling.distribution import Drawn, Parameter, Value, number
from factory.sampling.mission_kind import MissionKind, keeps_level, survey_row
from twin.errors import InputError
from twin.mission import LawnMower, Segment, Surface, Transect
from twin.vehicle.vehicle import Vehicle

DEPTH, ALTITUDE = "depth", "altitude"
SHALLOWEST_FLOOR_M = 25.0
"""[m] The sea floor of a survey is cut off here; the depths and altitudes below keep clear of it"""
_ROWS_level = (
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
        return _ROWS_level

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


Streams = Mapping[str, Callable[[], Value]]
"""Draws of the parameters of segments, by name of the table"""


class SurfaceKind(MissionKind):
    """A climb to the surface and a stay."""

    name = "surface"
    uses = ("surface_duration_s",)

    def fits(self, vehicle: Vehicle) -> bool:
        """Every vehicle comes up."""
        return True

    def stay(self, streams: Streams) -> Drawn:
        """One stay; its own parameter alone is drawn, so that stays change no other segment."""
        drawn: dict[str, Value] = dict.fromkeys(streams, math.nan)
        drawn["mission.kind"] = self.name
        drawn["mission.surface_duration_s"] = streams["mission.surface_duration_s"]()
        return drawn

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """The stay."""
        return number(drawn, "mission.surface_duration_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """A stay at the surface."""
        return Surface(duration_s=number(drawn, "mission.surface_duration_s")), heading_deg


SURFACE = SurfaceKind()
