"""Glide balance: forces and moments of a steady motion, whose sum must be zero; glides, cruises.

Equations are Kirchhoff's with the rigid body's (Fossen 2021, sections 3.3 and 8.1), in still water
of the reference density, far below the surface. Steady flight and turns are their roots.

The polar is drag, lift and pitch moment of a hull over the angle of attack, divided by speed
squared. `steady_glide` inverts a trim: it finds the straight glide at a given pitch and net mass.
`steady_flight` finds angle of attack, propeller rate and position of the pitching part from the
balance of surge, heave and pitch.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np

from twin.errors import MissionError, VehicleError
from twin.frames import cross
from twin.numbers import Array, product, solved_system
from twin.vehicle.laws.base import Polar, polar_of_wrench, straight_flow
from twin.vehicle.laws.flow_frame import is_flow_frame
from twin.vehicle.parts import BatteryHinge, BatterySlide, Part
from twin.vehicle.vehicle import Vehicle

WIDEST = math.radians(20.0)
"""[rad] Largest angle of attack in the search for a steady glide; beyond it wings stall."""


class VehiclePolar:
    """Polar of a whole vehicle: a flow-frame law alone, or another law plus the parts at rest.

    Raises:
      VehicleError, MissionError: the vehicle cannot glide.
    """

    def __init__(self, vehicle: Vehicle):
        self._vehicle, law = vehicle, vehicle.law
        self.valid_angle = min(law.valid_angle, WIDEST)
        """[rad] Largest angle of attack."""
        if is_flow_frame(law):
            self.valid_angle = law.valid_angle
            if not (law.drag[0] > 0.0 and law.drag[1] >= 0.0 and law.lift[1] > 0.0):
                raise VehicleError(
                    f"vehicle {vehicle.name!r} cannot glide: drag {law.drag[0]:g}, "
                    f"{law.drag[1]:g} and lift slope {law.lift[1]:g} must be positive for a "
                    "closed-loop mission"
                )
            self.zero_lift = -law.zero_lift
            """[rad] Angle of attack without lift."""
            return
        from scipy.optimize import brentq  # 0.2 s to import, and rarely needed

        low, high = -self.valid_angle, self.valid_angle
        if not self.at(low).lift < 0.0 < self.at(high).lift:
            raise MissionError(
                f"vehicle {vehicle.name!r} has no lift to glide with: its lift does not change "
                f"sign within {math.degrees(high):.0f} deg of angle of attack"
            )
        self.zero_lift = float(brentq(lambda alpha: self.at(alpha).lift, low, high, xtol=1e-15))

    def at(self, alpha: float) -> Polar:
        """Forces divided by speed squared at an angle of attack [rad], with parts at rest."""
        vehicle, density = self._vehicle, self._vehicle.reference_density
        if is_flow_frame(vehicle.law):  # the coefficients are of the whole vehicle
            return vehicle.law.polar(alpha, density)
        nu_r = straight_flow(alpha)
        wrench = vehicle.law.wrench(nu_r, density)
        for part in vehicle.parts:
            wrench = wrench + part.wrench(part.rest, nu_r, density, 1e3)
        return polar_of_wrench(wrench, alpha)

    def drag_over_lift(self, angles: Array) -> Array:
        """Drag divided by lift at each angle of attack [rad]."""
        if is_flow_frame(self._vehicle.law):  # its formulas take arrays; every plan asks for 400
            polar = cast("Any", self._vehicle.law.polar)(angles, self._vehicle.reference_density)
            return np.asarray(polar.drag / polar.lift)
        polars = [self.at(alpha) for alpha in angles.tolist()]
        return np.array([one.drag / one.lift for one in polars])


DEEP = 1e3
"""[m] Depth at which every part is under water."""
SETTLED = 1e-9
"""[1] Largest residual of a root: force over weight, and moment over weight times one metre."""
_ITERATIONS = 40
_STEP = 1e-6
_LARGEST_STEP = 0.1
"""Limit of a Newton step of any unknown; a longer step may end beyond the stall of a fin."""
_LEAST_SHARE = 1e-3
"""Smallest fraction to which a Newton step that overshoots is shortened."""


def newton(left: Callable[[Array], Array], x: Array) -> Array | None:
    """Find a root of `left` to SETTLED, starting at `x`; None if none is found.

    Newton's method with central differences; a step that increases the residual is halved.
    """
    rest = left(x)
    for _ in range(_ITERATIONS):
        size = float(np.abs(rest).max())
        if size < SETTLED:
            return x
        slopes = [(left(x + d) - left(x - d)) / (2.0 * _STEP) for d in _STEP * np.eye(x.size)]
        step = solved_system(np.column_stack(slopes), -rest)
        if step is None:
            return None
        share = min(1.0, _LARGEST_STEP / float(np.abs(step).max()))
        rest = left(x + share * step)
        while not float(np.abs(rest).max()) < size and share > _LEAST_SHARE:
            share *= 0.5
            rest = left(x + share * step)
        x = x + share * step
    return None


def imbalance(
    vehicle: Vehicle,
    position: Array,
    velocity: Array,
    *,
    pitch: float,
    roll: float = 0.0,
    turn_rate: float = 0.0,
) -> Array:
    """Residual force [N] and moment about the CB [N m] of a steady motion, shape (6,), body FRD.

    Args:
      position: positions of the parts, shape (parts,), in their units; followers are moved with
        their leading parts.
      velocity: velocity through the water, shape (3,) [m/s], body FRD.
      pitch, roll: [rad]. turn_rate: about the vertical [rad/s], positive to starboard.
    """
    position = vehicle.allocated(position)
    down = np.array(
        [-math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)]
    )
    return left_over(vehicle, position, np.concatenate([velocity, turn_rate * down]), down)


def left_over(vehicle: Vehicle, position: Array, nu: Array, down: Array) -> Array:
    """Residual force [N] and moment about the CB [N m] of any motion, shape (6,), body FRD.

    Args:
      position: positions of the parts, shape (parts,), in their units.
      nu: velocity through the water [m/s] and rates [rad/s], shape (6,), body FRD.
      down: unit vector of the vertical in body axes, shape (3,).
    """
    velocity, omega = nu[:3], nu[3:]
    density, gravity = vehicle.reference_density, vehicle.gravity
    mass, first, impulse, spin = _momentum(vehicle, position, nu)
    water = product(vehicle.added_mass, nu) if vehicle.added_mass_coupling else np.zeros(6)

    wrench = vehicle.law.wrench(nu, density)
    volume = vehicle.neutral_volume
    for part, place in zip(vehicle.parts, position.tolist(), strict=True):
        if part.fossen_wrench is not None:
            wrench = wrench + part.wrench(place, nu, density, DEEP)
        if part.fossen_volume is not None:
            own = part.displaced(place)
            volume += own
            wrench[3:] -= density * own * gravity * cross(np.array(part.position), down)
    wrench[:3] += (mass - density * volume) * gravity * down - cross(omega, impulse + water[:3])
    wrench[3:] += gravity * cross(first, down) - cross(omega, spin + water[3:])
    wrench[3:] -= cross(velocity, impulse + water[:3])
    return wrench


def mass_matrix(vehicle: Vehicle, position: Array) -> Array:
    """Rigid-body and added mass about the CB, shape (6, 6), body FRD, at given part positions."""
    rows = [np.concatenate(_momentum(vehicle, position, unit)[2:]) for unit in np.eye(6)]
    return np.array(rows).T + vehicle.added_mass


def _momentum(vehicle: Vehicle, position: Array, nu: Array) -> tuple[float, Array, Array, Array]:
    """Mass [kg] and its first moment [kg m]; momentum and angular momentum about the CB."""
    velocity, omega = nu[:3], nu[3:]
    mass, first = vehicle.static_mass, vehicle.static_mass * vehicle.static_cg
    inertia = product(vehicle.static_inertia, omega)
    inertia = inertia + _spin(vehicle.static_mass, vehicle.static_cg, omega)
    at = dict(zip(vehicle.part_names, position, strict=True))
    for moving in vehicle.masses:
        hinge = None if moving.hinge is None else vehicle.part(moving.hinge)
        hung = hinge.neutral if isinstance(hinge, BatteryHinge) else 0.0
        turned = at.get(moving.hinge or "", 0.0) - hung
        place = moving.position(at.get(moving.slide or "", 0.0), turned)
        mass += moving.mass
        first = first + moving.mass * place
        inertia = inertia + product(moving.inertia, omega) + _spin(moving.mass, place, omega)
    return mass, first, mass * velocity + cross(omega, first), inertia + cross(first, velocity)


def _spin(mass: float, place: Array, omega: Array) -> Array:
    """Angular momentum [N m s] of a point mass that turns about the CB, shape (3,)."""
    return mass * cross(place, cross(omega, place))


_GRID = np.linspace(0.0, 1.0, 401)[1:]
"""Fractions of the interval from zero lift to the largest angle of attack."""
_BISECTIONS = 60
"""Number of halvings that bring any interval of angles below double precision."""


@dataclass(frozen=True, kw_only=True)
class SteadyGlide:
    """Straight glide in still water of the reference density."""

    angle_of_attack: float
    """[rad] Angle of attack."""
    speed: float
    """[m/s] Speed through the water."""
    vertical_speed: float
    """[m/s] Vertical speed, positive down."""
    shift: float
    """[m] Battery displacement that balances the glide; may exceed the vehicle's travel."""


def steady_glide(vehicle: Vehicle, pitch: float, net_mass: float) -> SteadyGlide:
    """Find the glide at `pitch` [rad] and `net_mass` [kg]: nose down if heavy, nose up if light.

    If two glides have this pitch, the result is the glide with the smaller angle of attack.

    Raises:
      MissionError: the pitch is too shallow for the vehicle's lift and drag inside the identified
        angles of attack, or the signs disagree.
    """
    if pitch * net_mass >= 0.0:
        raise MissionError(
            f"pitch {math.degrees(pitch):g} deg with net mass {net_mass:g} kg is not a glide: a "
            "heavy glider dives nose down, a light one climbs nose up"
        )
    sense = math.copysign(1.0, net_mass)
    polar = VehiclePolar(vehicle)
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

    def steeper(alpha: float) -> bool:
        return alpha == zero_lift or not abs(pitch_at(alpha)) < abs(pitch)

    _, alpha = _bisect(steeper, zero_lift, float(angles[shallowest]))
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
    vehicle: Vehicle, pitch: float, net_mass: float, alpha: float, speed: float, coefficient: float
) -> float:
    """Shift [m] at which the pitch moments about the CB balance, wings level; 0 without a slide.

    Gravity gives -g (x cos(pitch) + z sin(pitch)), with (x, z) the first moments of mass [kg m]
    minus that of the water displaced by the pump at its place. The water gives (K_M0 + K_M alpha)
    V^2 and the Munk moment (Z_A - X_A) u w of the added mass.
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


LONGITUDINAL = (0, 2, 4)
"""Rows of surge force, heave force and pitch moment in a wrench."""
_LARGEST_ANGLE = math.radians(45.0)
"""[rad] Largest angle of attack that counts as flight."""


class SteadyCruise(NamedTuple):
    """Straight propelled flight in still water of the reference density."""

    pitch: float
    """[rad] Pitch, positive nose up."""
    angle_of_attack: float
    """[rad] Angle of attack."""
    position: Array
    """Positions of the parts, (parts,), in their units; the pitching part may exceed its travel."""


def steady_flight(
    vehicle: Vehicle, pitch: float | None, speed: float, position: Array
) -> SteadyCruise:
    """Find the flight at a pitch [rad] and speed [m/s] through the water; pitch None flies level.

    Args:
      position: of the parts, shape (parts,). The propeller's rate and the pitching part's position
        are solved for, the others stay. A vehicle without a pitching part gets `pitch` or 0, and
        the propeller rate for zero angle of attack.

    Raises:
      MissionError: the propeller cannot reach the speed (the message gives the largest one), or
        no such flight exists.
    """
    found = _steady_flight(vehicle, pitch, speed, tuple(np.asarray(position, float).tolist()))
    return found._replace(position=found.position.copy())


@functools.lru_cache(maxsize=256)
def _steady_flight(
    vehicle: Vehicle, pitch: float | None, speed: float, rest: tuple[float, ...]
) -> SteadyCruise:
    """Find the flight and cache it: a mission and its time limit need the same few flights."""
    driving, pitching = vehicle.steered_index("speed"), vehicle.steered_index("pitch")
    assert driving is not None
    position = np.array(rest)
    position[driving] = cruise_rate(vehicle, speed)
    if pitching is None:
        return SteadyCruise(pitch or 0.0, 0.0, position)
    free = [pitching, driving]
    parts = (vehicle.parts[i] for i in free)
    scale = np.array([1.0, *(max(abs(part.low), abs(part.high)) for part in parts)])

    def flight(x: Array) -> SteadyCruise:
        at = position.copy()
        at[free] = x[1:] * scale[1:]
        return SteadyCruise(float(x[0]) if pitch is None else pitch, float(x[0]), at)

    def left(x: Array) -> Array:
        f = flight(x)
        velocity = speed * np.array([math.cos(f.angle_of_attack), 0.0, math.sin(f.angle_of_attack)])
        wrench = imbalance(vehicle, f.position, velocity, pitch=f.pitch)
        return np.asarray(wrench[list(LONGITUDINAL)] / (vehicle.mass * vehicle.gravity))

    x = newton(left, np.array([0.0, *(position[free] / scale[1:])]))
    if x is not None and abs(x[0]) < _LARGEST_ANGLE:
        return flight(x)
    way = "level" if pitch is None else f"at a pitch of {math.degrees(pitch):.4g} deg"
    raise MissionError(
        f"vehicle {vehicle.name!r} has no steady flight {way} at {speed:g} m/s: give another "
        "speed_m_s, or a shallower pitch"
    )


def _bisect(below: Callable[[float], bool], low: float, high: float) -> tuple[float, float]:
    """Ends of an interval after _BISECTIONS halvings around the point where `below` turns false."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if below(middle):
            low = middle
        else:
            high = middle
    return low, high


def cruise_rate(vehicle: Vehicle, speed: float) -> float:
    """Propeller rate [rad/s] whose thrust equals the drag of hull and parts at `speed` ahead.

    Raises:
      MissionError: no rate suffices; the message gives the largest speed [m/s] of the propeller.
    """
    driving = vehicle.steered("speed")
    assert driving is not None
    most = float(driving.high)
    if not surplus(vehicle, driving.high, speed) >= 0.0:
        fast, _ = _bisect(lambda v: surplus(vehicle, driving.high, v) >= 0.0, 0.0, speed)
        raise MissionError(
            f"speed_m_s = {speed:g}: propeller {driving.name!r} of vehicle {vehicle.name!r} drives "
            f"it at up to {fast:.2f} m/s ({driving.high:g} rad/s); give less"
        )
    left = surplus_at(vehicle, speed)
    return _bisect(lambda rate: not left(rate) >= 0.0, 0.0, most)[1]


def surplus(vehicle: Vehicle, rate: float, speed: float) -> float:
    """Thrust minus drag [N] at a propeller's `rate` [rad/s] and `speed` [m/s] straight ahead."""
    return surplus_at(vehicle, speed)(rate)


def surplus_at(vehicle: Vehicle, speed: float) -> Callable[[float], float]:
    """Function from propeller rate to `surplus` at a speed; other parts are evaluated once."""
    nu_r, density = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), vehicle.reference_density
    driving, position = vehicle.steering["speed"], vehicle.rest
    place = vehicle.part_names.index(driving)
    moved = {driving, *(one.part for one in vehicle.followers if one.lead == driving)}
    hull = float(vehicle.law.wrench(nu_r, density)[0])

    def push(part: Part, at: float) -> float:
        return float(part.wrench(float(at), nu_r, density, DEEP)[0])

    pushes = [push(*one) for one in zip(vehicle.parts, position, strict=True)]
    turning = [(k, part) for k, part in enumerate(vehicle.parts) if part.name in moved]

    def left(rate: float) -> float:
        position[place] = rate
        at = vehicle.allocated(position, (driving,))
        for k, part in turning:
            pushes[k] = push(part, at[k])
        return functools.reduce(operator.add, pushes, hull)  # sum() rounds otherwise from 3.12 on

    return left
