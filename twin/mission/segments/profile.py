"""Dives and climbs between two depths: what all share, saw-teeth on a heading, and spirals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.errors import MissionError
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import Segment, blank_row, command_of, limit, write_way
from twin.mission.turning import turn_factor
from twin.mission.way import (
    TIME_MARGIN,
    Way,
    check_net_mass,
    checked_rotation,
    heading,
    reject_missing,
    turn_limit,
    way,
)
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle

DEFAULT_MIN_DEPTH_M = 5.0
"""Deep enough that the overshoot of an inflection (2 m for the Sea-Wing) stays submerged."""
SHALLOWEST_M = 1.0
"""A climb to less than this would end afloat: the hull breaks the surface before its CB arrives."""


@dataclass(frozen=True, kw_only=True)
class Profile(Segment):
    """Dives and climbs between two depths; the base of `SawTooth` and `Spiral`."""

    limits: ClassVar[tuple[str, ...]] = ("yos", "duration_s", "until_depth_m")

    max_depth_m: float
    """A dive turns into a climb here [m]."""
    min_depth_m: float = DEFAULT_MIN_DEPTH_M
    """A climb turns into a dive here [m]."""
    min_altitude_m: float | None = None
    """A dive turns into a climb this far above the sea floor [m], too; None: at `max_depth_m`
    only. Of runs with a sea floor."""
    pitch_deg: float = 35.0
    """Pitch magnitude [deg], above 0 and below 60."""
    climb_pitch_deg: float | None = None
    """Pitch magnitude of the climb [deg]; None: that of the dive."""
    net_mass_kg: float | None = None
    """Net buoyancy mass of the dive [kg], positive; the climb is this much light. Of vehicles
    with a pump; None: the `usual_glide` of the vehicle file, 0.3 where it does not say; neutral
    under a propeller."""
    climb_net_mass_kg: float | None = None
    """Magnitude for the climb [kg]; None: that of the dive."""
    speed_m_s: float | None = None
    """Speed through the water [m/s] of a vehicle with a propeller; None: its cruising speed."""
    trim_share: float | None = None
    """Part of the pitch that the battery holds, 0 to 1; the elevator holds the rest. Of vehicles
    with a battery beside an elevator; it is slow, and on short legs it comes late. None: 0."""
    yos: float | None = None
    """Limit: number of dives with their climbs, in halves (0.5 is one dive)."""
    duration_s: float | None = None
    """Limit: time [s]."""
    until_depth_m: float | None = None
    """Limit: the segment ends when the glider passes this depth [m]."""

    def __post_init__(self) -> None:
        kind = self.kind
        check.within(kind, "min_depth_m", self.min_depth_m, "m", SHALLOWEST_M)
        check.fields(self, kind, "until_depth_m")
        if self.min_depth_m >= self.max_depth_m:
            rule = f"less than max_depth_m = {self.max_depth_m:g} m"
            check.fail(kind, "min_depth_m", self.min_depth_m, rule)
        if self.yos is not None and (2 * self.yos) % 1:
            check.fail(kind, "yos", self.yos, "a multiple of 0.5")
        if self.until_depth_m is not None:
            low, high = self.min_depth_m, self.max_depth_m
            check.within(kind, "until_depth_m", self.until_depth_m, "m", low, high)

    def _ways(self, vehicle: Vehicle, label: str) -> tuple[Way, Way]:
        """How the vehicle dives and climbs; raises MissionError when it cannot."""
        reject_missing(vehicle, label, self)
        climb_pitch = "pitch_deg" if self.climb_pitch_deg is None else "climb_pitch_deg"
        climb_mass = "net_mass_kg" if self.climb_net_mass_kg is None else "climb_net_mass_kg"
        usual = 0.0 if vehicle.steered("speed") is not None else vehicle.usual_glide[1]
        heavy = usual if self.net_mass_kg is None else self.net_mass_kg
        light = -(heavy if self.climb_net_mass_kg is None else self.climb_net_mass_kg)
        if vehicle.steered("buoyancy") is not None:
            check_net_mass(vehicle, label, "net_mass_kg", heavy)
            check_net_mass(vehicle, label, climb_mass, light)
        speed, share = self.speed_m_s, self.trim_share or 0.0
        up = getattr(self, climb_pitch)
        return (
            way(vehicle, label, "pitch_deg", -self.pitch_deg, heavy, speed, trim_share=share),
            way(vehicle, label, climb_pitch, up, light, speed, trim_share=share),
        )

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Turning depths, pitches and the steady commands of both ways."""
        row = blank_row(vehicle)
        dive, climb = self._ways(vehicle, label)
        row[g.MIN_DEPTH], row[g.MAX_DEPTH] = self.min_depth_m, self.max_depth_m
        row[g.MIN_ALTITUDE] = limit(self.min_altitude_m)
        row[g.DIVE_PITCH], row[g.CLIMB_PITCH] = dive.pitch, climb.pitch
        row[g.DIVE_TURN], row[g.CLIMB_TURN] = (turn_factor(vehicle, w) for w in (dive, climb))
        command_of(vehicle, row, g.DIVE_COMMAND)[:] = dive.command
        command_of(vehicle, row, g.CLIMB_COMMAND)[:] = climb.command
        write_way(row, g.DIVE_COMMAND, dive, vehicle)
        write_way(row, g.CLIMB_COMMAND, climb, vehicle)
        row[g.YO_LIMIT], row[g.DURATION] = limit(self.yos), limit(self.duration_s)
        row[g.UNTIL_DEPTH] = limit(self.until_depth_m)
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Its limit in time, or its depth ranges at the steady vertical speeds with a margin."""
        dive, climb = self._ways(vehicle, label)
        yo = (self.max_depth_m - self.min_depth_m) * (
            1.0 / dive.vertical_speed - 1.0 / climb.vertical_speed
        )
        slowest = min(dive.vertical_speed, -climb.vertical_speed)
        approach = abs(depth - self.min_depth_m) / slowest
        times = [] if self.duration_s is None else [self.duration_s]
        if self.yos is not None:
            times.append(TIME_MARGIN * (approach + self.yos * yo))
        if self.until_depth_m is not None:
            times.append(TIME_MARGIN * (approach + 1.5 * yo))
        return min(times), self.max_depth_m


@dataclass(frozen=True, kw_only=True)
class SawTooth(Profile):
    """Wings-level dives and climbs on a heading."""

    kind = "saw-tooth"

    heading_deg: float | None = None
    """Heading to hold [deg true]; None: the heading at the segment's start."""
    max_rotation_deg: float = 45.0
    """Limit of the heading loop [deg]: of a battery's rotation or a rudder's deflection; a glider
    rolls less than it turns its battery."""

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """A profile with the heading loop."""
        row = super().row(vehicle, label)
        row[g.KIND] = g.SAW_TOOTH
        row[g.HEADING] = heading(self.heading_deg)
        row[g.TURN_LIMIT] = turn_limit(vehicle, self.max_rotation_deg)
        return row


@dataclass(frozen=True, kw_only=True)
class Spiral(Profile):
    """Dives and climbs at a fixed battery rotation or rudder; the heading loop rests."""

    kind = "spiral"

    rotation_deg: float
    """Position of the turning part [deg], a battery's rotation or a rudder's deflection; a
    battery's positive one turns to starboard, in a dive and in a climb."""
    climb_rotation_deg: float | None = None
    """The same in the climb [deg]; None: that of the dive."""

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """A profile with a fixed position of what turns the vehicle."""
        row = super().row(vehicle, label)
        row[g.KIND] = g.SPIRAL
        turning = vehicle.steered_index("heading")
        if turning is None:
            raise MissionError(
                f"{label}: vehicle {vehicle.name!r} has no part that turns it: give a saw-tooth"
            )
        dive = checked_rotation(vehicle, label, "rotation_deg", self.rotation_deg)
        climb = dive
        if self.climb_rotation_deg is not None:
            field, rotation = "climb_rotation_deg", self.climb_rotation_deg
            climb = checked_rotation(vehicle, label, field, rotation)
        command_of(vehicle, row, g.DIVE_COMMAND)[turning] = dive
        command_of(vehicle, row, g.CLIMB_COMMAND)[turning] = climb
        return row
