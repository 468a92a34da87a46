"""Profiles: dives and climbs between two depths, as saw-teeth on a heading or as spirals."""

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
"""[m] Default upper turning depth, so that inflections (2 m for the Sea-Wing) stay submerged."""
SHALLOWEST_M = 1.0
"""[m] Smallest upper turning depth: above it, the hull would surface before its CB arrives."""


@dataclass(frozen=True, kw_only=True)
class Profile(Segment):
    """Dives and climbs between two depths; base of `SawTooth` and `Spiral`."""

    limits: ClassVar[tuple[str, ...]] = ("yos", "duration_s", "until_depth_m")

    max_depth_m: float
    """Depth at which a dive turns into a climb [m]."""
    min_depth_m: float = DEFAULT_MIN_DEPTH_M
    """Depth at which a climb turns into a dive [m]."""
    min_altitude_m: float | None = None
    """Height above the sea floor at which a dive turns, too [m]; needs a sea floor. None: dives
    turn at `max_depth_m` only."""
    pitch_deg: float = 35.0
    """Magnitude of pitch in the dive [deg], above 0 and below 60."""
    climb_pitch_deg: float | None = None
    """Magnitude of pitch in the climb [deg]; None: that of the dive."""
    net_mass_kg: float | None = None
    """Net mass in the dive [kg], positive; the climb is lighter than neutral by the same mass. Only
    for vehicles with a pump. None: the `usual_glide` of the vehicle file, or 0.3 without it; 0 for
    propelled vehicles."""
    climb_net_mass_kg: float | None = None
    """Magnitude of net mass in the climb [kg]; None: that of the dive."""
    speed_m_s: float | None = None
    """Speed of a propelled vehicle through the water [m/s]; None: its cruising speed."""
    trim_share: float | None = None
    """Fraction of the pitch that the battery holds, 0 to 1; the elevator holds the rest. Only for
    vehicles with both. The battery is slow and lags on short legs. None: 0."""
    yos: float | None = None
    """Limit: number of yos, each a dive and a climb, in halves (0.5 is one dive)."""
    duration_s: float | None = None
    """Limit: time [s]."""
    until_depth_m: float | None = None
    """Limit: the segment ends when the vehicle passes this depth [m]."""

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
        """Steady dive and climb; raises MissionError if the vehicle cannot fly them."""
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
        """Row with turning depths, pitches, and the steady commands of dive and climb."""
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
        """Time [s] by its limits, at steady vertical speeds with a margin; and `max_depth_m`."""
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
    """Limit of the turning part in the heading loop [deg]: of a battery's rotation or a rudder's
    deflection. A glider rolls less than its battery rotates."""

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Row of a profile with the heading loop."""
        row = super().row(vehicle, label)
        row[g.KIND] = g.SAW_TOOTH
        row[g.HEADING] = heading(self.heading_deg)
        row[g.TURN_LIMIT] = turn_limit(vehicle, self.max_rotation_deg)
        return row


@dataclass(frozen=True, kw_only=True)
class Spiral(Profile):
    """Dives and climbs at a fixed battery rotation or rudder, without the heading loop."""

    kind = "spiral"

    rotation_deg: float
    """Position of the turning part in the dive [deg]: a battery's rotation, mass to port positive,
    or a rudder's deflection. A battery turns a vehicle to the side that its lift decides."""
    climb_rotation_deg: float | None = None
    """Position of the turning part in the climb [deg]; None: that of the dive."""

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Row of a profile with a fixed position of the turning part."""
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
