"""Cruise: the steady straight flight under a propeller, level or at a pitch.

Angle of attack, propeller rate and the position of what pitches the vehicle are those at which
surge, heave and pitch balance (`twin.mission.glide_balance`), found by Newton's method.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from collections.abc import Callable

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
    found = _steady_flight(vehicle, pitch, speed, tuple(np.asarray(position, float).tolist()))
    return dataclasses.replace(found, position=found.position.copy())


@functools.lru_cache(maxsize=256)
def _steady_flight(
    vehicle: Vehicle, pitch: float | None, speed: float, rest: tuple[float, ...]
) -> SteadyCruise:
    """The same, once: segments of a mission, and its time limit, ask for few flights."""
    driving, pitching = vehicle.steered_index("speed"), vehicle.steered_index("pitch")
    assert driving is not None
    position = np.array(rest)
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
    low, high, left = 0.0, float(driving.high), surplus_at(vehicle, speed)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if left(middle) >= 0.0:
            high = middle
        else:
            low = middle
    return high


def surplus(vehicle: Vehicle, rate: float, speed: float) -> float:
    """Thrust less drag [N] at a propeller's `rate` [rad/s] and `speed` [m/s] straight ahead."""
    return surplus_at(vehicle, speed)(rate)


def surplus_at(vehicle: Vehicle, speed: float) -> Callable[[float], float]:
    """`surplus` at a speed, of the rate; parts that do not go along with it are asked once."""
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
