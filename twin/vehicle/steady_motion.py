"""Steady motion of a glider at fixed actuator positions: its numbers and a root finder.

The MuJoCo twin and the Fossen equations both return the same `Trim`, so that their steady states
can be compared field by field.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.compiled import jit
from twin.errors import InputError, NoSteadyState, unknown_name
from twin.numbers import Array
from twin.vehicle.parts import BatterySlide
from twin.vehicle.parts.pump import CUBIC_CM

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

STRAIGHT_TURN_RATE = 1e-8
"""[rad/s] Turn rate below which the track counts as straight: the radius exceeds 10 000 km."""
RESIDUAL_TOLERANCE = 1e-9
"""[m/s2, rad/s2] Largest acceleration that counts as steady; kept for an hour, it changes the
speed by 4 micrometres per second."""
DISTINCT_ROOTS = 1e-6
"""Largest difference, in every unknown, between two roots that count as the same motion."""
NEUTRAL = 1e-9
"""[kg] Net mass below which buoyancy propels no glide."""
LIMIT_SLACK = 1e-9
"""Fraction of an actuator's travel by which rounding may exceed the ends."""
ITERATIONS = 30
"""Iterations of the fixed point. Each multiplies the error by 2 K_D alpha / (K_alpha tan(glide
angle)), which is below 0.3 for glides steeper than 15 deg."""


@dataclass(frozen=True, kw_only=True)
class Trim:
    """A steady glide or spiral through the water, independent of heading and current."""

    speed_m_s: float
    """speed through the water [m/s]"""
    angle_of_attack_deg: float
    """atan2(heave, surge) [deg]"""
    sideslip_deg: float
    """asin(sway / speed) [deg]"""
    roll_deg: float
    """roll, positive to starboard [deg]"""
    pitch_deg: float
    """pitch, positive nose up [deg]"""
    turn_rate_rad_s: float
    """rate of heading about the vertical, positive to starboard [rad/s]"""
    turn_radius_m: float | None
    """horizontal speed / |turn rate| [m]; None when the track is straight"""
    vertical_speed_m_s: float
    """rate of depth [m/s], positive down"""
    in_identified_range: bool
    """True when angle of attack and sideslip are within the range of identified coefficients"""

    @classmethod
    def from_motion(
        cls,
        *,
        v_rel: ArrayLike,
        roll: float,
        pitch: float,
        turn_rate: float,
        linear_angle: float,
    ) -> Trim:
        """Compute the numbers of a steady motion.

        `v_rel` [m/s], shape (3,), body FRD, through the water; `roll`, `pitch` [rad];
        `turn_rate` [rad/s] about the vertical; `linear_angle` [rad] bounds the identified
        range (`HullLaw.valid_angle`).
        """
        u, v, w = (float(component) for component in np.asarray(v_rel, dtype=float))
        roll, pitch, turn_rate = float(roll), float(pitch), float(turn_rate)
        speed = math.sqrt(u * u + v * v + w * w)
        if not speed > 0.0:
            raise InputError("a steady motion needs a speed above 0 m/s to have flow angles")
        alpha = math.atan2(w, u)
        beta = math.asin(max(-1.0, min(1.0, v / speed)))
        down = -math.sin(pitch) * u + math.cos(pitch) * (math.sin(roll) * v + math.cos(roll) * w)
        horizontal = math.sqrt(max(speed * speed - down * down, 0.0))
        straight = abs(turn_rate) < STRAIGHT_TURN_RATE
        return cls(
            speed_m_s=speed,
            angle_of_attack_deg=math.degrees(alpha),
            sideslip_deg=math.degrees(beta),
            roll_deg=math.degrees(roll),
            pitch_deg=math.degrees(pitch),
            turn_rate_rad_s=turn_rate,
            turn_radius_m=None if straight else horizontal / abs(turn_rate),
            vertical_speed_m_s=down,
            in_identified_range=max(abs(alpha), abs(beta)) <= linear_angle,
        )


def trim_positions(
    vehicle: Vehicle,
    shift: float = 0.0,
    rotation: float = 0.0,
    net_mass: float = 0.0,
    positions: Mapping[str, float] | None = None,
) -> NDArray[np.float64]:
    """Positions of the parts, shape (parts,), for a requested steady motion.

    Args:
      shift: [m] of a battery slide. rotation: [rad] of the part that turns the vehicle.
      net_mass: [kg] that the pump sets at reference density: - density * pumped volume.
      positions: of parts by name, in their units; override the above. All other parts rest.

    Raises:
      InputError: a position is outside a part's travel, or the vehicle lacks the part.
    """
    wanted, names = vehicle.rest, vehicle.part_names
    slide = vehicle.steered("pitch")
    for name, value, part, what, unit in (
        ("shift", shift, slide if isinstance(slide, BatterySlide) else None, "battery slide", "m"),
        ("rotation", rotation, vehicle.steered("heading"), "part that turns it", "deg"),
        ("net mass", net_mass, vehicle.steered("buoyancy"), "pump", "kg"),
    ):
        if part is None:
            if value:
                raise InputError(
                    f"{name} {value:g}: vehicle {vehicle.name!r} has no {what}; its parts: "
                    f"{', '.join(names)}"
                )
            continue
        ends, position = (part.low, part.high), value
        if unit == "kg":
            ends = (vehicle.net_mass_for_pump(part.high), vehicle.net_mass_for_pump(part.low))
            position = vehicle.pump_for_net_mass(value)
        _check_reach(vehicle, name, value, *ends, unit)
        wanted[names.index(part.name)] = position
    for name, value in (positions or {}).items():
        if name not in names:
            raise InputError(unknown_name(f"part of vehicle {vehicle.name!r}", name, names))
        part = vehicle.part(name)
        _check_reach(vehicle, name, value, part.low, part.high, part.unit)
        wanted[names.index(name)] = value
    return wanted


def driven(vehicle: Vehicle, positions: NDArray[np.float64]) -> bool:
    """Tell whether a propeller turns at these positions of the parts, shape (parts,)."""
    driving = vehicle.steered_index("speed")
    return driving is not None and abs(float(positions[driving])) > 0.0


def require_drive(vehicle: Vehicle, positions: NDArray[np.float64], net_mass: float) -> None:
    """Raise NoSteadyState, with advice, when neither buoyancy nor a propeller moves the vehicle.

    net_mass: [kg] at these positions of its parts.
    """
    if abs(net_mass) >= NEUTRAL or driven(vehicle, positions):
        return
    ways = []
    if vehicle.steered("buoyancy") is not None:
        ways.append("give a net mass above or below 0")
    driving = vehicle.steered("speed")
    if driving is not None:
        ways.append(
            f"give its part {driving.name!r} a position, up to {driving.high:g} {driving.unit}"
        )
    raise NoSteadyState(
        f"net mass {abs(net_mass):g} kg: a neutrally buoyant vehicle has no force to move with; "
        + (" or ".join(ways) or f"vehicle {vehicle.name!r} has no part that drives it")
    )


def positions_text(vehicle: Vehicle, positions: NDArray[np.float64]) -> str:
    """Text of the positions of the parts, shape (parts,), for messages."""
    pairs = zip(vehicle.parts, positions, strict=True)
    return ", ".join(f"{part.name} {part.text(value)}" for part, value in pairs)


def advice(vehicle: Vehicle, positions: NDArray[np.float64]) -> str:
    """Advice for `positions` of the parts, shape (parts,), at which no steady motion exists."""
    slides, turned, resting = list[str](), list[str](), list[str]()
    for part, position, rest in zip(vehicle.parts, positions, vehicle.rest, strict=True):
        if isinstance(part, BatterySlide):
            slides.append(part.name)
        elif {"pitch", "heading"} & set(part.controls()):
            away = abs(position - rest) > LIMIT_SLACK * (part.high - part.low)
            (turned if away else resting).append(part.name)
    ways = []
    if slides:
        ways.append(f"move the {' and '.join(slides)} forward to dive or aft to climb")
    if turned:
        ways.append(f"turn {' and '.join(turned)} less")
    elif resting and not slides:
        ways.append(f"nothing that steers it is turned: give {' or '.join(resting)} a position")
    if "speed" in vehicle.steering:
        ways.append(f"drive it at another speed with {vehicle.steering['speed']}")
    return ", or ".join(ways) or "change the positions of its parts"


def _check_reach(
    vehicle: Vehicle, name: str, value: float, low: float, high: float, unit: str
) -> None:
    scale = math.degrees(1.0) if unit == "deg" else 1.0
    in_unit, low, high = float(value) * scale, float(low) * scale, float(high) * scale
    slack = LIMIT_SLACK * (high - low)
    if not low - slack <= in_unit <= high + slack:
        raise InputError(
            f"{name} {in_unit:g} {unit} is outside the travel of vehicle {vehicle.name!r}: "
            f"give a value from {low:g} to {high:g} {unit}"
        )


def solve_steady_state(
    residual: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    guesses: Iterable[ArrayLike],
) -> list[NDArray[np.float64]]:
    """Find all distinct roots of `residual` that Powell's hybrid method reaches from `guesses`.

    `residual` maps n unknowns to n accelerations. A root is kept when all accelerations are below
    `RESIDUAL_TOLERANCE`. The list is empty when no guess leads to a root.
    """
    from scipy.optimize import root

    roots: list[NDArray[np.float64]] = []
    for guess in guesses:
        # hybr may report failure at its noise floor, so the residual alone decides
        found: Any = root(residual, np.asarray(guess, dtype=float), method="hybr", tol=1e-13)
        if not np.all(np.isfinite(found.x)):
            continue
        if np.max(np.abs(residual(found.x))) > RESIDUAL_TOLERANCE:
            continue
        if all(np.max(np.abs(found.x - other)) > DISTINCT_ROOTS for other in roots):
            roots.append(np.asarray(found.x, dtype=float))
    return roots


def net_mass(vehicle: Vehicle, pump: Array, depth: Array) -> Array:
    """Net buoyancy mass [kg], + = heavy, at the reference density; pump [cm3], depth [m]."""
    pressure = vehicle.reference_density * vehicle.gravity * depth
    volume = (vehicle.neutral_volume + CUBIC_CM * pump) * (
        1.0 - vehicle.hull_compressibility * pressure
    )
    return vehicle.mass - vehicle.reference_density * volume


def balance(
    vehicle: Vehicle, net: Array, roll: Array, pitch: Array, rates: Array
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Steady motion at each sample.

    Args:
      net: net buoyancy mass [kg], (time,).
      roll, pitch: [rad], (time,).
      rates: roll, pitch and yaw rate [rad/s], body FRD, (3, time).

    Returns:
      Speed [m/s], angle of attack and sideslip [rad], and True where a steady motion exists. At an
      inflection none exists, because no weight acts along the hull. Each (time,).
    """
    law = vehicle.flow_frame
    inertia = vehicle.mass * np.eye(3) + vehicle.added_mass[:3, :3]
    coefficients = np.array([*law.drag[:2], *law.lift[:2], law.side_force[0], law.blend_angle])
    found = np.zeros((4, len(pitch)))
    given = vehicle.gravity * np.asarray(net, float), roll, pitch, rates, inertia, coefficients
    _balance(*(np.asarray(values, float) for values in given), found)
    speed, alpha, beta, gliding = found
    return speed, alpha, beta, gliding > 0.0


@jit
def _balance(pull, roll, pitch, rates, inertia, law, found):  # type: ignore[no-untyped-def]
    """Write the fixed point of each sample into `found`; `pull` [N] is the weight in water."""
    for k in range(len(pitch)):
        down_x = -math.sin(pitch[k])
        down_y = math.cos(pitch[k]) * math.sin(roll[k])
        down_z = math.cos(pitch[k]) * math.cos(roll[k])
        weight = pull[k] * down_x, pull[k] * down_y, pull[k] * down_z
        turning = rates[0, k], rates[1, k], rates[2, k]
        v, a, b, along = 0.0, 0.0, 0.0, 0.0
        for _ in range(ITERATIONS):
            before = v, a, b
            along, v, a, b = balanced_forces(inertia, law, weight, turning, v, a, b)
            if (v, a, b) == before:
                break
        found[0, k], found[1, k], found[2, k] = v, a, b
        found[3, k] = along > 0.0 and abs(a) < law[5] and abs(b) < law[5]


@jit
def balanced_forces(inertia, law, weight, turning, v, a, b):  # type: ignore[no-untyped-def]
    """Iterate once towards the balance from a speed [m/s], angle of attack and sideslip [rad].

    Args:
      inertia: with added mass, (3, 3).
      law: K_D0, K_D, K_L0, K_alpha, K_beta and the largest angle [rad].
      weight, turning: forces [N] and rates [rad/s], body FRD.

    Returns:
      the force [N] along the path, positive if a balance exists, and the next three numbers.
    """
    c_a, s_a, c_b, s_b = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
    surge, sway, heave = v * c_a * c_b, v * s_b, v * s_a * c_b
    m0 = inertia[0, 0] * surge + inertia[0, 1] * sway + inertia[0, 2] * heave
    m1 = inertia[1, 0] * surge + inertia[1, 1] * sway + inertia[1, 2] * heave
    m2 = inertia[2, 0] * surge + inertia[2, 1] * sway + inertia[2, 2] * heave
    p, q, r = turning
    x = weight[0] + m1 * r - m2 * q
    y = weight[1] + m2 * p - m0 * r
    z = weight[2] + m0 * q - m1 * p
    # Rows of R_BC^T (Zhang et al. 2013).
    along = c_a * c_b * x + s_b * y + s_a * c_b * z
    side = -c_a * s_b * x + c_b * y - s_a * s_b * z
    normal = -s_a * x + c_a * z
    if along <= 0.0:
        return along, 0.0, 0.0, 0.0
    square = along / (law[0] + law[1] * a * a)
    attack = min(max((normal / square - law[2]) / law[3], -law[5]), law[5])
    slip = min(max(-side / square / law[4], -law[5]), law[5])
    return along, math.sqrt(square), attack, slip
