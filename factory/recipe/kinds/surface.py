"""Surface: a stay at the surface for a GPS fix. It is not drawn among the kinds: `surface_every`
says after how many of the others it comes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from factory.recipe.distribution import Value
from factory.recipe.drawn import Drawn, number
from factory.recipe.kinds.base import MissionKind
from twin.mission import Segment, Surface
from twin.vehicle.vehicle import Vehicle

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
