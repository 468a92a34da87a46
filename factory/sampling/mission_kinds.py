"""Mission kinds: the segments that the factory draws, from their parameters to guidance.

Saw-tooth: dives and climbs on a heading, also called yo-yo.
Spiral: dives and climbs that turn all the time.
Surface: a stay at the surface for a GPS fix. It is not drawn among the kinds: `surface_every`
says after how many of the others it comes.
Transect: straight and level on a heading.
Circle: level turns of one radius.
Lawn-mower: parallel legs to and fro that cover an area.
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
"""Segments without a clock are drawn until their steady ways take this many mission times."""
DEPTHS = ("max_depth_m", "min_depth_m", "pitch_deg", "climb_pitch_deg")
DRIVEN = ("net_mass_kg", "climb_net_mass_kg", "speed_m_s")
"""Of vehicles that a pump drives, and of those with a propeller"""
Streams = Mapping[str, Callable[[], Value]]
"""Draws of the parameters of segments, by name of the table"""


def _value(drawn: Drawn, name: str) -> float:
    """A number of a segment, by its name without the group."""
    return number(drawn, f"mission.{name}")


class MissionKind:
    """One kind of segment."""

    name: ClassVar[str] = ""
    """What `mission.kind` draws"""
    uses: ClassVar[tuple[str, ...]] = ()
    """Parameters of the table that it is made of, without their group `mission.`; those that a
    vehicle has not are left out"""

    def fits(self, vehicle: Vehicle) -> bool:
        """Whether a vehicle has the parts to fly it."""
        return True

    def keep(self, drawn: Drawn) -> Drawn:
        """The draws of one segment without those that this kind does not use: they are NaN."""
        used = {"mission.kind", *(f"mission.{name}" for name in self.uses)}
        return {name: value if name in used else math.nan for name, value in drawn.items()}

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """Time [s] that it lasts at least; inf when it does not end by itself.

        Raises:
          MissionError: the vehicle cannot fly it.
        """
        raise NotImplementedError

    def deepest_m(self, drawn: Drawn) -> float:
        """Depth [m] that it goes to; 0 when it follows the sea floor or stays up."""
        return 0.0

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """What guidance flies, and the heading [deg true] after it.

        Raises:
          MissionError: its numbers are no segment.
        """
        raise NotImplementedError


class _Profile(MissionKind):
    """Dives and climbs between two depths."""

    uses: ClassVar[tuple[str, ...]] = (
        *DEPTHS, *DRIVEN, "yos", "segment_duration_s", "min_altitude_m",
    )  # fmt: skip

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        """Its clock, or its dives and climbs at their steady speeds."""
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
        # a segment without limits is the last one
        return min(times, default=math.inf)

    def deepest_m(self, drawn: Drawn) -> float:
        return _value(drawn, "max_depth_m")

    def fields(self, drawn: Drawn) -> dict[str, Any]:
        """What both segments take."""
        driven = [name for name in DRIVEN if f"mission.{name}" in drawn]
        return {
            **{name: _value(drawn, name) for name in (*DEPTHS, *driven)},
            "yos": limit(drawn, "mission.yos"),
            "duration_s": limit(drawn, "mission.segment_duration_s"),
            "min_altitude_m": limit(drawn, "mission.min_altitude_m"),
        }


class _SawTooth(_Profile):
    """A new heading for each, where something turns the vehicle."""

    name = "saw-tooth"
    uses = (*_Profile.uses, "heading_change_deg")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        if vehicle.steered("heading"):
            heading_deg = (heading_deg + _value(drawn, "heading_change_deg")) % 360.0
        return missions.SawTooth(heading_deg=heading_deg, **self.fields(drawn)), heading_deg


class _Spiral(_Profile):
    """At a fixed position of what turns the vehicle."""

    name = "spiral"
    uses = (*_Profile.uses, "rotation_deg")

    def fits(self, vehicle: Vehicle) -> bool:
        """Something must turn it."""
        return vehicle.steered("heading") is not None

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """A spiral; the next saw-tooth goes on from the heading before it."""
        rotation = _value(drawn, "rotation_deg")
        return missions.Spiral(rotation_deg=rotation, **self.fields(drawn)), heading_deg


class _Surface(MissionKind):
    """A climb to the surface and a stay."""

    name = "surface"
    uses = ("surface_duration_s",)

    def stay(self, streams: Streams) -> Drawn:
        """One stay; its own parameter alone is drawn, so that stays change no other segment."""
        duration = "mission.surface_duration_s"
        own: Drawn = {"mission.kind": self.name, duration: streams[duration]()}
        return {**dict.fromkeys(streams, math.nan), **own}

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        return _value(drawn, "surface_duration_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        return missions.Surface(duration_s=_value(drawn, "surface_duration_s")), heading_deg


class _Level(MissionKind):
    """At a depth or an altitude, at a speed."""

    uses: ClassVar[tuple[str, ...]] = (
        "level_by", "depth_m", "altitude_m", "min_altitude_m", "speed_m_s",
    )  # fmt: skip

    def fits(self, vehicle: Vehicle) -> bool:
        """A propeller, and what pitches and turns it."""
        return keeps_level(vehicle)

    def keep(self, drawn: Drawn) -> Drawn:
        """With one of depth and altitude; raises InputError for another word."""
        other = {DEPTH: "mission.altitude_m", ALTITUDE: "mission.depth_m"}
        by = drawn["mission.level_by"]
        if by not in other:
            raise InputError(f"mission.level_by = {by}: choose among {DEPTH} and {ALTITUDE}")
        return {**super().keep(drawn), other[str(by)]: math.nan}

    def deepest_m(self, drawn: Drawn) -> float:
        depth = _value(drawn, "depth_m")
        return 0.0 if math.isnan(depth) else depth

    def fields(self, drawn: Drawn) -> dict[str, Any]:
        """Depth or altitude, and the speed."""
        held = "depth_m" if drawn["mission.level_by"] == DEPTH else "altitude_m"
        return {name: _value(drawn, name) for name in (held, "min_altitude_m", "speed_m_s")}


class _Transect(_Level):
    """A new heading for each, for a time."""

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
    """Some turns at a depth or an altitude."""

    name = "circle"
    uses = (*_Level.uses, "radius_m", "turns")

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        around = 2.0 * math.pi * abs(_value(drawn, "radius_m"))
        return around * _value(drawn, "turns") / _value(drawn, "speed_m_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """A circle; the next heading is drawn from the one before it."""
        radius, turns = _value(drawn, "radius_m"), _value(drawn, "turns")
        return missions.Circle(radius_m=radius, turns=turns, **self.fields(drawn)), heading_deg


class _LawnMower(_Level):
    """Legs at a depth or an altitude."""

    name = "lawn-mower"
    uses = (*_Level.uses, "heading_change_deg", "leg_length_m", "spacing_m", "legs")

    def shortest_time(self, drawn: Drawn, vehicle: Vehicle) -> float:
        legs = _value(drawn, "legs") * _value(drawn, "leg_length_m")
        return legs / _value(drawn, "speed_m_s")

    def segment(self, drawn: Drawn, heading_deg: float, vehicle: Vehicle) -> tuple[Segment, float]:
        """A lawn-mower, its legs on a new heading."""
        heading = (heading_deg + _value(drawn, "heading_change_deg")) % 360.0
        legs = {name: _value(drawn, name) for name in ("leg_length_m", "spacing_m", "legs")}
        return missions.LawnMower(heading_deg=heading, **legs, **self.fields(drawn)), heading


SURFACE = _Surface()
MISSION_KINDS: Mapping[str, MissionKind] = {
    kind.name: kind
    for kind in (_SawTooth(), _Spiral(), SURFACE, _Transect(), _Circle(), _LawnMower())
}
"""Segments that the factory draws; stores keep their positions."""


def kinds_for(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the kinds that a vehicle can fly; stores keep their positions."""
    return tuple(name for name, kind in MISSION_KINDS.items() if kind.fits(vehicle))


def propelled(vehicle: Vehicle) -> bool:
    """Whether a propeller drives the vehicle: it flies surveys above a sea floor."""
    return vehicle.steered("speed") is not None


def keeps_level(vehicle: Vehicle) -> bool:
    """Whether it can hold a depth under its propeller, and turn to a heading there."""
    steered = (vehicle.steered(control) for control in ("speed", "pitch", "heading"))
    return vehicle.depth_pid is not None and all(part is not None for part in steered)
