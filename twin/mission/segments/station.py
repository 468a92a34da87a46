"""Stations: segments without a leg: hold the parts, hover at a depth, stay at the surface."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from twin.errors import MissionError
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments.base import Segment, blank_row, command_of, limit, write_way
from twin.mission.segments.level import check_place
from twin.mission.segments.pose import pose_row
from twin.mission.stationing import DEPTH_RATE
from twin.mission.turning import turn_factor
from twin.mission.way import (
    TIME_MARGIN,
    Way,
    check_net_mass,
    checked_part,
    checked_rotation,
    checked_shift,
    heading,
    reject_missing,
    standing_shift,
    turn_limit,
    way,
)
from twin.numbers import Array
from twin.vehicle.parts import BatterySlide
from twin.vehicle.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class Hold(Segment):
    """Open-loop manoeuvre: fixed positions of the parts, without any loop."""

    kind = "hold"
    limits = ("duration_s", "until_depth_m")

    shift_m: float = 0.0
    """Battery displacement from neutral [m], positive forward (nose down)."""
    rotation_deg: float = 0.0
    """Rotation of the battery [deg], mass to port positive; or deflection of the rudder."""
    net_mass_kg: float = 0.0
    """Net mass [kg], signed: positive is heavy."""
    parts: Mapping[str, float] = field(default_factory=dict)
    """Positions by part, in the parts' units (rad, m, cm3, rad/s), for vehicles with other parts:
    `parts = { propeller = 30.0, rudder = 0.1 }`."""
    duration_s: float | None = None
    """Limit: time [s]."""
    until_depth_m: float | None = None
    """Limit: the segment ends when the vehicle passes this depth [m]."""

    def __post_init__(self) -> None:
        check.fields(self, self.kind, "net_mass_kg")
        check.number(self.kind, "net_mass_kg", self.net_mass_kg)
        if not isinstance(self.parts, Mapping):
            check.fail(self.kind, "parts", self.parts, "a table of positions by part")
        for name, value in self.parts.items():
            check.number(self.kind, f"parts.{name}", value)

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Row with one command for all parts."""
        reject_missing(vehicle, label, self)
        row = blank_row(vehicle)
        row[g.KIND] = g.HOLD
        rest = command_of(vehicle, row, g.REST_COMMAND)
        pitching = vehicle.steered("pitch")
        if isinstance(pitching, BatterySlide):
            place = vehicle.part_names.index(pitching.name)
            rest[place] = checked_shift(vehicle, label, self.shift_m)
        turning, pump = vehicle.steered_index("heading"), vehicle.steered_index("buoyancy")
        if turning is not None:
            rest[turning] = checked_rotation(vehicle, label, "rotation_deg", self.rotation_deg)
        if pump is not None:
            check_net_mass(vehicle, label, "net_mass_kg", self.net_mass_kg)
            rest[pump] = vehicle.pump_for_net_mass(self.net_mass_kg)
        for name, value in self.parts.items():
            rest[checked_part(vehicle, label, name, value)] = value
        row[g.DURATION], row[g.UNTIL_DEPTH] = limit(self.duration_s), limit(self.until_depth_m)
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Time `duration_s` [s] and the same depth [m]; the motion of an open loop is unknown."""
        if self.duration_s is None:
            raise MissionError(
                f"{label}: a hold until a depth takes an unknown time: give it a duration_s as "
                "well, or give the mission one"
            )
        return self.duration_s, depth


@dataclass(frozen=True, kw_only=True)
class Hover(Segment):
    """Drift with the water at a depth or at a height above the sea floor, held by the pump.

    A vehicle with thrusters holds its place and heading as well.
    """

    kind = "hover"
    limits = ("duration_s",)

    depth_m: float | None = None
    """Depth to keep [m]; give this or `altitude_m`."""
    altitude_m: float | None = None
    """Height above the sea floor to keep [m]; needs a sea floor."""
    pitch_deg: float = 0.0
    """Pitch to hold [deg], positive nose up; for vehicles with a battery slide."""
    duration_s: float | None = None
    """Limit: time [s]."""

    def __post_init__(self) -> None:
        check_place(self.kind, self.depth_m, self.altitude_m)
        most = check.MAX_PITCH_DEG
        check.within(self.kind, "pitch_deg", self.pitch_deg, "deg", -most, most)
        check.fields(self, self.kind, "pitch_deg")

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Row with the pump's loop about neutral and the battery's about its standing shift.

        Raises:
          MissionError: the vehicle has no pump, its file has no gains for the pump, or its battery
            cannot hold the pitch.
        """
        if vehicle.holds_pose and not self.pitch_deg:
            row = pose_row(vehicle, label)
            row[g.DEPTH], row[g.ALTITUDE] = limit(self.depth_m), limit(self.altitude_m)
            row[g.MIN_DEPTH], row[g.DURATION] = 0.0, limit(self.duration_s)
            return row
        reject_missing(vehicle, label, self)
        if vehicle.steered("buoyancy") is None or vehicle.buoyancy_pid is None:
            lacks = "pump" if vehicle.steered("buoyancy") is None else "numeric 'buoyancy_pid'"
            raise MissionError(
                f"{label}: the file of vehicle {vehicle.name!r} has no {lacks}: nothing holds a "
                "depth without speed"
            )
        pitch = math.radians(self.pitch_deg)
        row = blank_row(vehicle)
        row[g.KIND] = g.HOVER
        row[g.DEPTH], row[g.ALTITUDE] = limit(self.depth_m), limit(self.altitude_m)
        row[g.MIN_DEPTH], row[g.LEVEL_PITCH] = 0.0, pitch
        row[g.DURATION] = limit(self.duration_s)
        movable = map(vehicle.steered, ("trim", "pitch"))
        slide = next((part for part in movable if isinstance(part, BatterySlide)), None)
        if slide is None:
            if pitch:
                raise MissionError(
                    f"{label}: pitch_deg = {self.pitch_deg:g}: vehicle {vehicle.name!r} has no "
                    "battery that slides: leave pitch_deg out"
                )
            return row
        shift = standing_shift(vehicle, slide, pitch)
        if not slide.low <= shift <= slide.high:
            rule = (
                f"less (it needs the {slide.name} at {slide.text(shift)}, and vehicle "
                f"{vehicle.name!r} moves it from {slide.text(slide.low)} to "
                f"{slide.text(slide.high)})"
            )
            check.fail(label, "pitch_deg", self.pitch_deg, rule)
        command_of(vehicle, row, g.REST_COMMAND)[vehicle.part_names.index(slide.name)] = shift
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Time `duration_s` [s] and the depth [m] that it keeps."""
        assert self.duration_s is not None
        return self.duration_s, depth if self.depth_m is None else self.depth_m


@dataclass(frozen=True, kw_only=True)
class Surface(Segment):
    """Climb to the surface, then wait there tail up, with the antenna out of the water."""

    kind = "surface"

    duration_s: float = 300.0
    """Time at the surface [s], counted from arrival."""
    pitch_deg: float = 35.0
    """Magnitude of pitch in the ascent [deg]."""
    net_mass_kg: float | None = None
    """Magnitude of net mass in the ascent, which is light [kg]; None: all that the pump can do."""
    speed_m_s: float | None = None
    """Speed of a propelled vehicle in the ascent [m/s]; None: its cruising speed."""
    heading_deg: float | None = None
    """Heading of the ascent [deg true]; None: the heading at the segment's start."""
    max_rotation_deg: float = 45.0
    """Limit of the turning part in the heading loop during the ascent [deg]."""
    shift_m: float | None = None
    """Battery position while at the surface [m]; None: all the way forward, tail up. For vehicles
    with a battery slide."""

    def __post_init__(self) -> None:
        check.fields(self, self.kind)

    def _ascent(self, vehicle: Vehicle, label: str) -> Way:
        """Steady climb to the surface."""
        reject_missing(vehicle, label, self)
        mass, pump = 0.0, vehicle.steered("buoyancy")
        if pump is not None:
            mass = vehicle.net_mass_for_pump(float(pump.high))
            if self.net_mass_kg is not None:
                mass = -self.net_mass_kg
                check_net_mass(vehicle, label, "net_mass_kg", mass)
        # with an elevator, the pump helps the climb if the elevator cannot hold the pitch
        within = not isinstance(vehicle.steered("pitch"), BatterySlide)
        pitch, speed = self.pitch_deg, self.speed_m_s
        return way(vehicle, label, "pitch_deg", pitch, mass, speed, within_travel=within)

    def row(self, vehicle: Vehicle, label: str) -> Array:
        """Row of a climb with the heading loop, then rest with the tail up."""
        if vehicle.holds_pose:
            row = pose_row(vehicle, label, g.SURFACE)
            row[g.DEPTH], row[g.HEADING] = 0.0, heading(self.heading_deg)
            row[g.DURATION] = self.duration_s
            return row
        row = blank_row(vehicle)
        climb = self._ascent(vehicle, label)
        row[g.KIND] = g.SURFACE
        row[g.CLIMB_PITCH] = climb.pitch
        row[g.CLIMB_TURN] = turn_factor(vehicle, climb)
        command_of(vehicle, row, g.CLIMB_COMMAND)[:] = climb.command
        write_way(row, g.CLIMB_COMMAND, climb, vehicle)
        rest = command_of(vehicle, row, g.REST_COMMAND)
        pump, pitching = vehicle.steered_index("buoyancy"), vehicle.steered("pitch")
        if pump is not None:
            rest[pump] = climb.command[pump]
        if isinstance(pitching, BatterySlide):
            place = vehicle.part_names.index(pitching.name)
            rest[place] = pitching.high
            if self.shift_m is not None:
                rest[place] = checked_shift(vehicle, label, self.shift_m)
        row[g.DURATION] = self.duration_s
        row[g.HEADING] = heading(self.heading_deg)
        row[g.TURN_LIMIT] = turn_limit(vehicle, self.max_rotation_deg)
        return row

    def expected(self, vehicle: Vehicle, depth: float, label: str) -> tuple[float, float]:
        """Time [s] of the climb with a margin and of the wait; depth 0."""
        if vehicle.holds_pose:
            return TIME_MARGIN * depth / DEPTH_RATE + self.duration_s, 0.0
        climb = self._ascent(vehicle, label)
        return TIME_MARGIN * depth / -climb.vertical_speed + self.duration_s, 0.0
