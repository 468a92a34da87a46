"""Steady straight glide at a wanted pitch and net buoyancy: the inverse of a trim.

Guidance feeds the shift forward, and a mission's duration is estimated from the vertical speed.
Straight flight needs no solver: for an angle of attack alpha the balance of lift and drag along and
across the flow gives the glide angle gamma = atan(-D / L) and so the pitch alpha + gamma (Graver
2005, section 4.1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.errors import MissionError
from twin.mission.polar import polar_of
from twin.vehicle.parts import BatterySlide
from twin.vehicle.vehicle import Vehicle

_GRID = np.linspace(0.0, 1.0, 401)[1:]
"""Fractions of the way from zero lift to the limit of the identified angles."""
_BISECTIONS = 60
"""Halvings that take any interval of angles below double precision."""


@dataclass(frozen=True, kw_only=True)
class SteadyGlide:
    """A straight glide in still water of the reference density."""

    angle_of_attack: float
    """[rad]"""
    speed: float
    """[m/s] through the water"""
    vertical_speed: float
    """[m/s], positive down"""
    shift: float
    """[m], battery displacement that holds it; may be outside the vehicle's travel"""


def steady_glide(vehicle: Vehicle, pitch: float, net_mass: float) -> SteadyGlide:
    """The glide at `pitch` [rad] and `net_mass` [kg]: nose down and heavy, or nose up and light.

    Of the two glides that may share a pitch it is the one with the smaller angle of attack.

    Raises:
      MissionError: the pitch is too shallow for the vehicle's lift and drag inside the identified
        angles of attack, or the signs disagree.
    """
    if pitch * net_mass >= 0.0:
        raise MissionError(
            f"pitch {math.degrees(pitch):g} deg with net mass {net_mass:g} kg is no glide: a heavy "
            "glider dives nose down, a light one climbs nose up"
        )
    sense = math.copysign(1.0, net_mass)
    polar = polar_of(vehicle)
    zero_lift = polar.zero_lift
    angles = zero_lift + (sense * polar.valid_angle - zero_lift) * _GRID

    def pitch_at(alpha: float) -> float:
        drag, lift, _ = polar.at(alpha)
        return alpha - math.atan(drag / lift)

    pitches = np.abs(angles - np.arctan(polar.drag_over_lift(angles)))
    shallowest = int(np.argmin(pitches))
    if abs(pitch) < pitches[shallowest]:
        raise MissionError(
            f"{abs(math.degrees(pitch)):g} deg is too shallow for vehicle {vehicle.name!r}: "
            f"it glides from {math.degrees(pitches[shallowest]):.1f} deg on"
        )
    near, far = zero_lift, float(angles[shallowest])  # steeper and shallower than wanted
    for _ in range(_BISECTIONS):
        middle = 0.5 * (near + far)
        if middle != zero_lift and abs(pitch_at(middle)) < abs(pitch):
            far = middle
        else:
            near = middle
    alpha = far
    glide_angle = pitch - alpha
    drag, _, moment = polar.at(alpha)
    speed = math.sqrt(-net_mass * vehicle.gravity * math.sin(glide_angle) / drag)
    return SteadyGlide(
        angle_of_attack=alpha,
        speed=speed,
        vertical_speed=-speed * math.sin(glide_angle),
        shift=_balancing_shift(vehicle, pitch, net_mass, alpha, speed, moment),
    )


def _balancing_shift(
    vehicle: Vehicle,
    pitch: float,
    net_mass: float,
    alpha: float,
    speed: float,
    coefficient: float,
) -> float:
    """Shift [m] at which the pitch moments about the CB balance, wings level; 0 without a slide.

    Gravity: -g (x cos(pitch) + z sin(pitch)) with (x, z) the first moments of mass [kg m], less
    that of the water that the pump displaces at its place; water: (K_M0 + K_M alpha) V^2 and the
    Munk moment (Z_A - X_A) u w of the added mass.
    """
    slide = vehicle.steered("pitch")
    if not isinstance(slide, BatterySlide):
        return 0.0
    munk = 0.0
    if vehicle.added_mass_coupling:
        munk = vehicle.added_mass[2, 2] - vehicle.added_mass[0, 0]
    moment = (coefficient + munk * math.sin(alpha) * math.cos(alpha)) * speed**2
    static = vehicle.static_mass
    neutral = static * vehicle.static_cg[0] + sum(m.mass * m.neutral_x for m in vehicle.masses)
    z = static * vehicle.static_cg[2] + sum(m.mass * m.eccentricity for m in vehicle.masses)
    pump = vehicle.steered("buoyancy")
    if pump is not None:
        neutral += net_mass * pump.position[0]
        z += net_mass * pump.position[2]
    x = (moment / vehicle.gravity - z * math.sin(pitch)) / math.cos(pitch)
    return float((x - neutral) / vehicle.moved_by(slide.name).mass)
