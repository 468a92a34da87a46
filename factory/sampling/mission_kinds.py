"""Mission kinds: types of segments that the factory samples, and their conversion for guidance.

Saw-tooth: dives and climbs on a heading, also called yo-yo.
Spiral: dives and climbs with a constant turn.
Surface: a surface interval for a GPS fix. `mission.kind` never samples this type; one follows after
every `surface_every` other segments.
Transect: a straight level leg on a heading.
Circle: level turns of one radius.
Lawn-mower: parallel level legs that cover an area.
Sticks: an ROV flown by hand, with depth hold and heading hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from factory.sampling.distribution import Drawn, Value, limit, number
from twin import mission as missions
from twin.errors import InputError

if TYPE_CHECKING:
    from twin.mission import Segment
    from twin.vehicle.vehicle import Vehicle

DEPTH, ALTITUDE = "depth", "altitude"
TIME_RESERVE = 1.5
"""[1] Steady duration of all sampled dives and climbs, relative to the mission's duration"""
DEPTHS = ("max_depth_m", "min_depth_m", "pitch_deg", "climb_pitch_deg")
DRIVEN = ("net_mass_kg", "climb_net_mass_kg", "speed_m_s")
"""Parameters of propulsion: net masses for a pump, speed for a propeller"""
Streams = Mapping[str, Callable[[], Value]]
"""Functions that sample a segment's parameters, by name in the table"""


def _value(drawn: Drawn, name: str) -> float:
    """Number of a segment, by the parameter's name without `mission.`."""
    return number(drawn, f"mission.{name}")


class MissionKind:
    """Type of segment."""

    name: ClassVar[str] = ""
    """Word for this type in `mission.kind`"""
    uses: ClassVar[tuple[str, ...]] = ()
    """Parameters that this type uses, without their group `mission.`; parameters that a vehicle
    lacks are left out"""

    def fits(self, vehicle: Vehicle) -> bool:
        """Return whether a vehicle has the parts to fly this type of segment."""
        return True

    def keep(self, drawn: Drawn) -> Drawn:
        """Return a segment's parameters, with NaN for those that this type does not use."""
        used = {"mission.kind", *(f"mission.{name}" for name in self.uses)}
        return {name: value if name in used else math.nan for name, value in drawn.items()}

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """[s] Shortest duration of the segment; inf if the segment does not end by itself.

        Raises:
          MissionError: the vehicle cannot fly the segment.
        """
        raise NotImplementedError

    def deepest_m(self, drawn: Drawn) -> float:
        """[m] Deepest depth of the segment; 0 if it follows the floor or stays at the surface."""
        return 0.0

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """Build the segment for guidance; returns it and the heading [deg true] after it.

        Raises:
          MissionError: the parameters make no valid segment.
        """
        raise NotImplementedError


class _Profile(MissionKind):
    """Dives and climbs between two depths."""

    uses: ClassVar[tuple[str, ...]] = (
        *DEPTHS, *DRIVEN, "yos", "segment_duration_s", "min_altitude_m",
    )  # fmt: skip

    def fits(self, vehicle: Vehicle) -> bool:
        """Return whether the vehicle dives and climbs by pitch, not by thrusters."""
        return not vehicle.holds_pose

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """[s] Time limit, or a lower bound for dives and climbs at their steady speeds."""
        clock, yos = _value(drawn, "segment_duration_s"), _value(drawn, "yos")
        times = [] if math.isnan(clock) else [clock]
        if not math.isnan(yos):
            height = _value(drawn, "max_depth_m") - _value(drawn, "min_depth_m")
            slowness = 0.0
            speed = _value(drawn, "speed_m_s") if "mission.speed_m_s" in drawn else None
            for sign, climb in ((1.0, ""), (-1.0, "climb_")):
                pitch, mass = f"{climb}pitch_deg", f"mission.{climb}net_mass_kg"
                angle = -sign * _value(drawn, pitch)
                heavy = sign * number(drawn, mass) if mass in drawn else 0.0
                steady = missions.track_to_follow(
                    vehicle, self.name, pitch, angle, heavy, speed, within_travel=True
                )
                slowness += 1.0 / abs(steady.vertical_speed)
            times.append(yos * height * slowness / TIME_RESERVE)
        # a segment without limits lasts until the end of the mission
        return min(times, default=math.inf)

    def deepest_m(self, drawn: Drawn) -> float:
        return _value(drawn, "max_depth_m")

    def fields(self, drawn: Drawn) -> dict[str, Any]:
        """Fields of both types of segments."""
        driven = [name for name in DRIVEN if f"mission.{name}" in drawn]
        return {
            **{name: _value(drawn, name) for name in (*DEPTHS, *driven)},
            "yos": limit(drawn, "mission.yos"),
            "duration_s": limit(drawn, "mission.segment_duration_s"),
            "min_altitude_m": limit(drawn, "mission.min_altitude_m"),
        }


class _SawTooth(_Profile):
    """Saw-tooth; each has a new heading if a part turns the vehicle."""

    name = "saw-tooth"
    uses = (*_Profile.uses, "heading_change_deg")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        if vehicle.steered("heading"):
            heading_deg = (heading_deg + _value(drawn, "heading_change_deg")) % 360.0
        return missions.SawTooth(heading_deg=heading_deg, **self.fields(drawn)), heading_deg


class _Spiral(_Profile):
    """Spiral with a fixed position of the part that turns the vehicle."""

    name = "spiral"
    uses = (*_Profile.uses, "rotation_deg")

    def fits(self, vehicle: Vehicle) -> bool:
        """Return whether a part turns the vehicle."""
        return vehicle.steered("heading") is not None

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """Build a spiral; the next saw-tooth continues from the heading before the spiral."""
        rotation = _value(drawn, "rotation_deg")
        return missions.Spiral(rotation_deg=rotation, **self.fields(drawn)), heading_deg


class _Surface(MissionKind):
    """Climb to the surface and a surface interval."""

    name = "surface"
    uses = ("surface_duration_s",)

    def stay(self, streams: Streams) -> Drawn:
        """Sample a surface interval: only its duration, so that no other segment changes."""
        duration = "mission.surface_duration_s"
        own: Drawn = {"mission.kind": self.name, duration: streams[duration]()}
        return {**dict.fromkeys(streams, math.nan), **own}

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        return _value(drawn, "surface_duration_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        return missions.Surface(duration_s=_value(drawn, "surface_duration_s")), heading_deg


class _Level(MissionKind):
    """Level segment at a depth or an altitude, with a speed."""

    uses: ClassVar[tuple[str, ...]] = (
        "level_by", "depth_m", "altitude_m", "min_altitude_m", "speed_m_s",
    )  # fmt: skip

    def fits(self, vehicle: Vehicle) -> bool:
        """Return whether the vehicle has a propeller and parts that pitch and turn it."""
        return keeps_level(vehicle)

    def keep(self, drawn: Drawn) -> Drawn:
        """Keep either depth or altitude; raises InputError for an unknown word in `level_by`."""
        other = {DEPTH: "mission.altitude_m", ALTITUDE: "mission.depth_m"}
        by = drawn["mission.level_by"]
        if by not in other:
            raise InputError(f"mission.level_by = {by}: choose among {DEPTH} and {ALTITUDE}")
        return {**super().keep(drawn), other[str(by)]: math.nan}

    def deepest_m(self, drawn: Drawn) -> float:
        depth = _value(drawn, "depth_m")
        return 0.0 if math.isnan(depth) else depth

    def fields(self, drawn: Drawn) -> dict[str, Any]:
        """Fields of depth or altitude, smallest altitude and speed."""
        held = "depth_m" if drawn["mission.level_by"] == DEPTH else "altitude_m"
        return {name: _value(drawn, name) for name in (held, "min_altitude_m", "speed_m_s")}


class _Transect(_Level):
    """Transect on a new heading, for a time."""

    name = "transect"
    uses = (*_Level.uses, "heading_change_deg", "segment_duration_s")

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        return _value(drawn, "segment_duration_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        heading = (heading_deg + _value(drawn, "heading_change_deg")) % 360.0
        duration = _value(drawn, "segment_duration_s")
        return missions.Transect(
            heading_deg=heading, duration_s=duration, **self.fields(drawn)
        ), heading


class _Circle(_Level):
    """Circle with some turns at a depth or an altitude."""

    name = "circle"
    uses = (*_Level.uses, "radius_m", "turns")

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        around = 2.0 * math.pi * abs(_value(drawn, "radius_m"))
        return around * _value(drawn, "turns") / _value(drawn, "speed_m_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """Build a circle; the next heading changes from the heading before the circle."""
        radius, turns = _value(drawn, "radius_m"), _value(drawn, "turns")
        return missions.Circle(radius_m=radius, turns=turns, **self.fields(drawn)), heading_deg


class _LawnMower(_Level):
    """Lawn-mower with legs at a depth or an altitude."""

    name = "lawn-mower"
    uses = (*_Level.uses, "heading_change_deg", "leg_length_m", "spacing_m", "legs")

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        legs = _value(drawn, "legs") * _value(drawn, "leg_length_m")
        return legs / _value(drawn, "speed_m_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """Build a lawn-mower with legs on a new heading."""
        heading = (heading_deg + _value(drawn, "heading_change_deg")) % 360.0
        legs = {name: _value(drawn, name) for name in ("leg_length_m", "spacing_m", "legs")}
        return missions.LawnMower(heading_deg=heading, **legs, **self.fields(drawn)), heading


class _Sticks(MissionKind):
    """Forces and a turn that a person holds for a while."""

    name = "sticks"
    uses = ("surge", "sway", "heave", "yaw_deg_s", "segment_duration_s")

    def fits(self, vehicle: Vehicle) -> bool:
        """Return whether thrusters hold the vehicle's pose."""
        return vehicle.holds_pose

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        return _value(drawn, "segment_duration_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        sticks = {name: _value(drawn, name) for name in self.uses[:4]}
        return missions.Sticks(
            duration_s=_value(drawn, "segment_duration_s"), **sticks
        ), heading_deg


SURFACE = _Surface()
MISSION_KINDS: Mapping[str, MissionKind] = {
    kind.name: kind
    for kind in (_SawTooth(), _Spiral(), SURFACE, _Transect(), _Circle(), _LawnMower(), _Sticks())
}
"""Types of segments by name, in a fixed order, because stores keep a type's position"""


def kinds_for(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the types that a vehicle can fly; stores keep a name's position in this list."""
    return tuple(name for name, kind in MISSION_KINDS.items() if kind.fits(vehicle))


def propelled(vehicle: Vehicle) -> bool:
    """Return whether the vehicle has a propeller, and so flies surveys above a sea floor."""
    return vehicle.steered("speed") is not None


def keeps_level(vehicle: Vehicle) -> bool:
    """Return whether a vehicle with a propeller can hold a depth and a heading."""
    steered = (vehicle.steered(control) for control in ("speed", "pitch", "heading"))
    return vehicle.depth_pid is not None and all(part is not None for part in steered)
