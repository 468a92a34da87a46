"""Profile: dives and climbs between two depths, what a saw-tooth and a spiral share."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from factory.recipe.drawn import Drawn, limit, number
from factory.recipe.kinds.base import MissionKind
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
