"""Cruise: the steady straight flight under a propeller, level or at a pitch.

Angle of attack, propeller rate and the position of what pitches the vehicle are those at which
surge, heave and pitch balance (`twin.mission.glide_balance`), found by Newton's method.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from twin.errors import MissionError
from twin.mission.glide_balance import DEEP, imbalance, newton
from twin.numbers import Array
from twin.vehicle.parts import Part
from twin.vehicle.vehicle import Vehicle

LONGITUDINAL = (0, 2, 4)
"""Rows of surge and heave force and pitch moment"""
_BISECTIONS = 60
"""Halvings that take any interval of rates below double precision."""
_LARGEST_ANGLE = math.radians(45.0)
"""Angles of attack beyond this are no flight."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SteadyCruise:
    """A straight flight in still water of the reference density."""

    pitch: float
    """[rad], positive nose up"""
    angle_of_attack: float
    """[rad]"""
    position: Array
    """of the parts, shape (parts,), in their units; may be outside the travel of what pitches"""


def steady_flight(
    vehicle: Vehicle, pitch: float | None, speed: float, position: Array
) -> SteadyCruise:
    """The flight at a pitch [rad] and speed [m/s] through the water; pitch None flies level.

    Args:
      position: of the parts, shape (parts,): the propeller and the part that pitches are found,
        the others stay. A vehicle that nothing pitches flies at the pitch that its moments allow
        and is given the rate for zero angle of attack.

    Raises:
      MissionError: the propeller cannot drive it so fast (the largest speed is named), or no such
        flight exists.
    """
    driving, pitching = vehicle.steered_index("speed"), vehicle.steered_index("pitch")
    assert driving is not None
    position = np.array(position, dtype=np.float64)
    position[driving] = cruise_rate(vehicle, speed)
    if pitching is None:
        return SteadyCruise(pitch=pitch or 0.0, angle_of_attack=0.0, position=position)
    free = (pitching, driving)
    scale = np.array([1.0, *(_travel(vehicle.parts[i]) for i in free)])

    def flight(x: Array) -> SteadyCruise:
        at = position.copy()
        at[list(free)] = x[1:] * scale[1:]
        steep = float(x[0]) if pitch is None else pitch
        return SteadyCruise(pitch=steep, angle_of_attack=float(x[0]), position=at)

    def left(x: Array) -> Array:
        f = flight(x)
        velocity = speed * np.array([math.cos(f.angle_of_attack), 0.0, math.sin(f.angle_of_attack)])
        wrench = imbalance(vehicle, f.position, velocity, pitch=f.pitch)
        return np.asarray(wrench[list(LONGITUDINAL)] / (vehicle.mass * vehicle.gravity))

    x = newton(left, np.array([0.0, *(position[list(free)] / scale[1:])]))
    if x is not None and abs(x[0]) < _LARGEST_ANGLE:
        return flight(x)
    way = "level" if pitch is None else f"at a pitch of {math.degrees(pitch):.4g} deg"
    raise MissionError(
        f"vehicle {vehicle.name!r} has no steady flight {way} at {speed:g} m/s: give another "
        "speed_m_s, or a shallower pitch"
    )


def _travel(part: Part) -> float:
    return max(abs(part.low), abs(part.high))


def cruise_rate(vehicle: Vehicle, speed: float) -> float:
    """Rate [rad/s] at which thrust equals the drag of hull and parts, straight ahead at `speed`.

    Raises:
      MissionError: the propeller cannot; the largest speed [m/s] that it can hold is named.
    """
    driving = vehicle.steered("speed")
    assert driving is not None
    if not surplus(vehicle, driving.high, speed) >= 0.0:
        slow, fast = 0.0, speed
        for _ in range(_BISECTIONS):
            middle = 0.5 * (slow + fast)
            if surplus(vehicle, driving.high, middle) >= 0.0:
                slow = middle
            else:
                fast = middle
        raise MissionError(
            f"speed_m_s = {speed:g}: propeller {driving.name!r} of vehicle {vehicle.name!r} drives "
            f"it at up to {slow:.2f} m/s ({driving.high:g} rad/s); give less"
        )
    low, high = 0.0, float(driving.high)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if surplus(vehicle, middle, speed) >= 0.0:
            high = middle
        else:
            low = middle
    return high


def surplus(vehicle: Vehicle, rate: float, speed: float) -> float:
    """Thrust less drag [N] at a propeller's `rate` [rad/s] and `speed` [m/s] straight ahead."""
    nu_r = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    density = vehicle.reference_density
    force = float(vehicle.law.wrench(nu_r, density)[0])
    position = vehicle.rest
    position[vehicle.part_names.index(vehicle.steering["speed"])] = rate
    for part, at in zip(vehicle.parts, vehicle.allocated(position), strict=True):
        force += float(part.wrench(float(at), nu_r, density, DEEP)[0])
    return force
