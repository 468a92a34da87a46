"""Segment table: segments as the rows that guidance flies, checked against the vehicle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.errors import MissionError
from twin.mission import guidance as g
from twin.mission.fields import fail
from twin.mission.glide import SteadyGlide, steady_glide
from twin.mission.segments import Hold, Profile, SawTooth, Segment, Spiral, Surface
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

SURFACED_MARGIN_M = 0.5
"""[m] added to half the hull's length: a glider that hangs at the surface by one end counts as
surfaced at any pitch, and waves or a pressure offset of this size do not hide it."""
SLACK = 1e-9
"""Relative rounding by which a value may exceed an actuator's travel."""


def segment_row(vehicle: Vehicle, segment: Segment, label: str) -> Array:
    """One table row, shape (SEGMENT_COLUMNS,).

    Raises:
      MissionError: a value beyond the vehicle's actuators or glides; `label` names the segment.
    """
    row = np.full(g.SEGMENT_COLUMNS, np.nan)
    row[g.ABORT_DEPTH] = np.inf
    row[g.SURFACE_DEPTH] = 0.5 * vehicle.hull_length + SURFACED_MARGIN_M
    row[g.SHIFT_MIN], row[g.SHIFT_MAX] = vehicle.actuator_min[0], vehicle.actuator_max[0]
    row[[g.DIVE_ROTATION, g.CLIMB_ROTATION, g.MAX_ROTATION]] = 0.0
    if isinstance(segment, Profile):
        _fill_profile(row, vehicle, segment, label)
    elif isinstance(segment, Surface):
        _fill_surface(row, vehicle, segment, label)
    elif isinstance(segment, Hold):
        _fill_hold(row, vehicle, segment, label)
    else:
        raise MissionError(f"{label}: {type(segment).__name__} is not a segment that can be flown")
    return row


def glides(vehicle: Vehicle, segment: Profile, label: str) -> tuple[SteadyGlide, SteadyGlide]:
    """Steady dive and climb of a segment; raises MissionError when the vehicle has none."""
    climb_pitch = segment.pitch_deg if segment.climb_pitch_deg is None else segment.climb_pitch_deg
    climb_mass = (
        segment.net_mass_kg if segment.climb_net_mass_kg is None else segment.climb_net_mass_kg
    )
    climb_pitch_field = "pitch_deg" if segment.climb_pitch_deg is None else "climb_pitch_deg"
    climb_mass_field = "net_mass_kg" if segment.climb_net_mass_kg is None else "climb_net_mass_kg"
    _check_net_mass(vehicle, label, "net_mass_kg", segment.net_mass_kg)
    _check_net_mass(vehicle, label, climb_mass_field, -climb_mass)
    return (
        _glide(vehicle, label, "pitch_deg", -segment.pitch_deg, segment.net_mass_kg),
        _glide(vehicle, label, climb_pitch_field, climb_pitch, -climb_mass),
    )


def ascent(vehicle: Vehicle, segment: Surface, label: str) -> tuple[SteadyGlide, float]:
    """Steady climb of a surfacing and its net mass [kg], negative."""
    mass = vehicle.net_mass_for_pump(float(vehicle.actuator_max[2]))
    if segment.net_mass_kg is not None:
        mass = -segment.net_mass_kg
        _check_net_mass(vehicle, label, "net_mass_kg", mass)
    return _glide(vehicle, label, "pitch_deg", segment.pitch_deg, mass), mass


def _fill_profile(row: Array, vehicle: Vehicle, segment: Profile, label: str) -> None:
    dive, climb = glides(vehicle, segment, label)
    climb_pitch = segment.pitch_deg if segment.climb_pitch_deg is None else segment.climb_pitch_deg
    climb_mass = (
        segment.net_mass_kg if segment.climb_net_mass_kg is None else segment.climb_net_mass_kg
    )
    row[g.MIN_DEPTH], row[g.MAX_DEPTH] = segment.min_depth_m, segment.max_depth_m
    row[g.DIVE_PITCH], row[g.CLIMB_PITCH] = np.radians([-segment.pitch_deg, climb_pitch])
    row[g.DIVE_SHIFT], row[g.CLIMB_SHIFT] = dive.shift, climb.shift
    row[g.DIVE_PUMP] = vehicle.pump_for_net_mass(segment.net_mass_kg)
    row[g.CLIMB_PUMP] = vehicle.pump_for_net_mass(-climb_mass)
    row[g.YO_LIMIT] = np.nan if segment.yos is None else segment.yos
    row[g.DURATION] = np.nan if segment.duration_s is None else segment.duration_s
    row[g.UNTIL_DEPTH] = np.nan if segment.until_depth_m is None else segment.until_depth_m
    if isinstance(segment, SawTooth):
        row[g.KIND] = g.SAW_TOOTH
        row[g.HEADING] = _heading(segment.heading_deg)
        row[g.MAX_ROTATION] = _rotation_limit(vehicle, segment.max_rotation_deg)
    elif isinstance(segment, Spiral):
        row[g.KIND] = g.SPIRAL
        rotation = segment.rotation_deg
        row[g.DIVE_ROTATION] = _checked_rotation(vehicle, label, "rotation_deg", rotation)
        row[g.CLIMB_ROTATION] = row[g.DIVE_ROTATION]
        if segment.climb_rotation_deg is not None:
            field, rotation = "climb_rotation_deg", segment.climb_rotation_deg
            row[g.CLIMB_ROTATION] = _checked_rotation(vehicle, label, field, rotation)


def _fill_surface(row: Array, vehicle: Vehicle, segment: Surface, label: str) -> None:
    climb, mass = ascent(vehicle, segment, label)
    row[g.KIND] = g.SURFACE
    row[g.CLIMB_PITCH] = math.radians(segment.pitch_deg)
    row[g.DIVE_SHIFT] = vehicle.actuator_max[0]
    if segment.shift_m is not None:
        row[g.DIVE_SHIFT] = _checked_shift(vehicle, label, segment.shift_m)
    row[g.CLIMB_SHIFT] = climb.shift
    row[g.CLIMB_PUMP] = vehicle.pump_for_net_mass(mass)
    row[g.DURATION] = segment.duration_s
    row[g.HEADING] = _heading(segment.heading_deg)
    row[g.MAX_ROTATION] = _rotation_limit(vehicle, segment.max_rotation_deg)


def _fill_hold(row: Array, vehicle: Vehicle, segment: Hold, label: str) -> None:
    _check_net_mass(vehicle, label, "net_mass_kg", segment.net_mass_kg)
    row[g.KIND] = g.HOLD
    row[g.DIVE_SHIFT] = _checked_shift(vehicle, label, segment.shift_m)
    row[g.DIVE_ROTATION] = _checked_rotation(vehicle, label, "rotation_deg", segment.rotation_deg)
    row[g.DIVE_PUMP] = vehicle.pump_for_net_mass(segment.net_mass_kg)
    row[g.DURATION] = np.nan if segment.duration_s is None else segment.duration_s
    row[g.UNTIL_DEPTH] = np.nan if segment.until_depth_m is None else segment.until_depth_m


def _heading(degrees: float | None) -> float:
    return math.nan if degrees is None else math.radians(degrees % 360.0)


def _rotation_limit(vehicle: Vehicle, degrees: float) -> float:
    """Symmetric limit [rad] of the heading loop inside the vehicle's travel."""
    travel = min(-vehicle.actuator_min[1], vehicle.actuator_max[1])
    return float(min(math.radians(degrees), max(travel, 0.0)))


def _check_travel(
    label: str, field: str, value: float, unit: str, low: float, high: float, vehicle: Vehicle
) -> None:
    slack = SLACK * (high - low)
    if not low - slack <= value <= high + slack:
        rule = f"{low:g} to {high:g} {unit} (travel of vehicle {vehicle.name!r})"
        fail(label, field, value, rule)


def _checked_shift(vehicle: Vehicle, label: str, shift: float) -> float:
    low, high = float(vehicle.actuator_min[0]), float(vehicle.actuator_max[0])
    _check_travel(label, "shift_m", shift, "m", low, high, vehicle)
    return shift


def _checked_rotation(vehicle: Vehicle, label: str, field: str, degrees: float) -> float:
    low, high = (math.degrees(limit[1]) for limit in (vehicle.actuator_min, vehicle.actuator_max))
    _check_travel(label, field, degrees, "deg", low, high, vehicle)
    return math.radians(degrees)


def _check_net_mass(vehicle: Vehicle, label: str, field: str, net_mass: float) -> None:
    """`net_mass` [kg] with its sign is within the pump's reach; messages speak of magnitudes."""
    heaviest = vehicle.net_mass_for_pump(float(vehicle.actuator_min[2]))
    lightest = -vehicle.net_mass_for_pump(float(vehicle.actuator_max[2]))
    reach, way = (heaviest, "heavy") if net_mass > 0 else (lightest, "light")
    if abs(net_mass) > reach * (1.0 + SLACK):
        rule = f"at most {reach:g} kg {way} (pump of vehicle {vehicle.name!r})"
        fail(label, field, abs(net_mass), rule)


def _glide(
    vehicle: Vehicle, label: str, field: str, pitch_deg: float, net_mass: float
) -> SteadyGlide:
    """The steady glide, whose shift must be within the battery's travel."""
    try:
        glide = steady_glide(vehicle, math.radians(pitch_deg), net_mass)
    except MissionError as error:
        raise MissionError(f"{label}: {field} = {abs(pitch_deg):g}: {error}") from None
    low, high = float(vehicle.actuator_min[0]), float(vehicle.actuator_max[0])
    if not low <= glide.shift <= high:
        rule = (
            f"a shallower pitch (it needs the battery at {glide.shift:.4f} m, and vehicle "
            f"{vehicle.name!r} moves it from {low:g} to {high:g} m)"
        )
        fail(label, field, abs(pitch_deg), rule)
    return glide
