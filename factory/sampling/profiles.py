"""Profile: dives and climbs between two depths, what a saw-tooth and a spiral share.

Saw-tooth: dives and climbs on a heading, also called yo-yo.
Spiral: dives and climbs that turn all the time.
Circle: level turns of one radius.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from factory.sampling.distribution import Drawn, Parameter, limit, number
from factory.sampling.mission_kind import MissionKind, survey_row
from factory.sampling.surveys import LAWN_MOWER, SURFACE, TRANSECT, LevelKind
from twin.mission import Circle, SawTooth, Segment, Spiral
from twin.mission.way import way
from twin.vehicle.vehicle import Vehicle

TIME_RESERVE = 1.5
"""Segments without a clock are drawn until their steady ways take this many mission times."""
DEPTHS = ("max_depth_m", "min_depth_m", "pitch_deg", "climb_pitch_deg")
DRIVEN = ("net_mass_kg", "climb_net_mass_kg", "speed_m_s")
"""Of vehicles that a pump drives, and of those with a propeller"""
ENDS = ("yos", "segment_duration_s", "min_altitude_m")


class ProfileKind(MissionKind):
    """Dives and climbs."""

    uses: ClassVar[tuple[str, ...]] = (*DEPTHS, *DRIVEN, *ENDS)

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """Its clock, or its dives and climbs at their steady speeds."""
        clock, yos = number(drawn, "mission.segment_duration_s"), number(drawn, "mission.yos")
        times = [] if math.isnan(clock) else [clock]
        if not math.isnan(yos):
            height = number(drawn, "mission.max_depth_m") - number(drawn, "mission.min_depth_m")
            slowness = 0.0
            speed = number(drawn, "mission.speed_m_s") if "mission.speed_m_s" in drawn else None
            for sign, pitch, mass in (
                (1.0, "pitch_deg", "mission.net_mass_kg"),
                (-1.0, "climb_pitch_deg", "mission.climb_net_mass_kg"),
            ):
                angle = -sign * number(drawn, f"mission.{pitch}")
                heavy = sign * number(drawn, mass) if mass in drawn else 0.0
                steady = way(vehicle, self.name, pitch, angle, heavy, speed, within_travel=True)
                slowness += 1.0 / abs(steady.vertical_speed)
            times.append(yos * height * slowness / TIME_RESERVE)
        # a segment without limits is the last one
        return min(times, default=math.inf)

    def deepest_m(self, drawn: Drawn) -> float:
        """Its lower turning depth."""
        return number(drawn, "mission.max_depth_m")

    def fields(self, drawn: Drawn) -> dict[str, Any]:
        """What both segments take."""
        driven = {n: number(drawn, f"mission.{n}") for n in DRIVEN if f"mission.{n}" in drawn}
        return {
            **{name: number(drawn, f"mission.{name}") for name in DEPTHS},
            **driven,
            "yos": limit(drawn, "mission.yos"),
            "duration_s": limit(drawn, "mission.segment_duration_s"),
            "min_altitude_m": limit(drawn, "mission.min_altitude_m"),
        }


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


MISSION_KINDS: Mapping[str, MissionKind] = {
    "saw-tooth": SAW_TOOTH,
    "spiral": SPIRAL,
    "surface": SURFACE,
    "transect": TRANSECT,
    "circle": CIRCLE,
    "lawn-mower": LAWN_MOWER,
}
"""Segments that the factory draws."""


def kinds_for(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the kinds that a vehicle can fly; stores keep their positions."""
    return tuple(name for name, kind in MISSION_KINDS.items() if kind.fits(vehicle))
