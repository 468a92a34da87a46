"""Turning: steady turn rate of a vehicle at a position of the part that turns it.

In sideslip, wings with sweep or dihedral roll a hull to opposite sides in a dive and in a climb; a
rudder acts alike in both. So sign and gain of a heading loop can differ between the phases. Both
follow from the vehicle's steady turns, linearised about straight motion.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from twin.errors import MissionError
from twin.mission.glide_balance import imbalance, newton
from twin.mission.way import Way, level_way, way
from twin.numbers import Array, solved_system
from twin.vehicle.parts import Fin
from twin.vehicle.vehicle import Vehicle

LATERAL = (1, 3, 5)
"""Rows of side force, roll moment and yaw moment in a wrench."""
STEP = 1e-5
"""[m/s, rad, rad/s] Step of the finite differences; the law is smooth at this scale."""
PART_STEP = 1e-4
"""[1] Step of the differences by the turning part's position, as a fraction of its travel."""
SLOWER_TURNS = 5
"""Number of stages to a steady turn, each started from the slower turn before."""
LARGEST_FACTOR = 4.0
"""[1] Limit of a loop's factor; its inverse is the lower limit."""


def turn_per_position(vehicle: Vehicle, steady: Way) -> float:
    """Turn rate [rad/s] about the vertical, to starboard, per unit of the turning part.

    Side force, roll moment and yaw moment vanish for the three unknowns sway, roll and turn rate
    (`twin.mission.glide_balance`, linearised about straight motion). 0 for a vehicle without a
    turning part.

    Raises:
      MissionError: the three equations do not determine a steady turn.
    """
    index = vehicle.steered_index("heading")
    if index is None:
        return 0.0
    numbers = (steady.pitch, steady.speed, steady.angle_of_attack, *steady.command.tolist())
    return _turn_per_position(vehicle, index, numbers)


@functools.lru_cache(maxsize=4096)
def _turn_per_position(vehicle: Vehicle, index: int, numbers: tuple[float, ...]) -> float:
    """Turn rate per position, cached: the segments of a mission have few different motions."""
    pitch, speed, alpha, *command = numbers
    part = vehicle.parts[index]

    def residual(x: Array, moved: float) -> Array:
        """Residual side force [N], roll and yaw moment [N m] at sway, roll and turn rate."""
        velocity = np.array([speed * math.cos(alpha), x[0], speed * math.sin(alpha)])
        position = np.array(command)
        position[index] = part.rest + moved
        motion = {"pitch": pitch, "roll": x[1], "turn_rate": x[2]}
        return imbalance(vehicle, position, velocity, **motion)[list(LATERAL)]

    slopes = [(residual(d, 0.0) - residual(-d, 0.0)) / (2.0 * STEP) for d in STEP * np.eye(3)]
    step = PART_STEP * (part.high - part.low)
    driven = (residual(np.zeros(3), step) - residual(np.zeros(3), -step)) / (2.0 * step)
    found = solved_system(np.column_stack(slopes), -driven)
    if found is None:
        raise MissionError(
            f"vehicle {vehicle.name!r}: its {part.name} determines no steady turn: side force, "
            "roll and yaw moment of the hull law do not depend on sideslip, roll and turn rate"
        )
    return float(found[2])


def turn_factor(vehicle: Vehicle, steady: Way) -> float:
    """Factor on the vehicle file's heading loop in a steady motion.

    The factor has the sign of the turn in this motion. Its size is the usual motion's turn rate
    divided by the turn rate in this one, within LARGEST_FACTOR. If the fins do not stabilise the
    hull, steady turns can oppose the rudder. The factor then has the sign of the rudder's moment,
    and its size is the usual speed divided by this one.

    Raises:
      MissionError: as for `turn_per_position`; or the part does not turn the vehicle.
    """
    if vehicle.steered("heading") is None:
        return 1.0
    here = turn_per_position(vehicle, steady)
    there, usual_speed = _usual_turn(vehicle)
    turning = vehicle.steered("heading")
    if isinstance(turning, Fin) and min(here * turning.sense("heading"), here * there) < 0.0:
        here, there = turning.sense("heading") * steady.speed, usual_speed
    if here == 0.0 or not math.isfinite(here):
        raise MissionError(
            f"vehicle {vehicle.name!r}: its {vehicle.steering['heading']} does not turn it"
        )
    size = min(max(abs(there / here), 1.0 / LARGEST_FACTOR), LARGEST_FACTOR)
    return math.copysign(size, here)


def circling(vehicle: Vehicle, steady: Way, turn_rate: float) -> Array:
    """Positions of the parts, shape (parts,), in a level propelled turn.

    Surge force, side force, roll and yaw moment vanish. The unknowns are sway, roll, propeller rate
    and position of the turning part; the speed is that of the straight motion.

    Args:
      steady: the straight level motion. turn_rate: [rad/s] about the vertical, to starboard.

    Raises:
      MissionError: no turning part, no such turn, or a part without enough travel.
    """
    turning, driving = vehicle.steered_index("heading"), vehicle.steered_index("speed")
    if turning is None or driving is None:
        what = "part that turns it" if turning is None else "propeller"
        raise MissionError(f"vehicle {vehicle.name!r} has no {what}: it flies no circle")
    free = [turning, driving]
    scale = np.array([vehicle.parts[i].high - vehicle.parts[i].low for i in free])

    def positions(x: Array) -> Array:
        position = steady.command.copy()
        position[free] = x[2:] * scale
        return position

    def left_at(x: Array, rate: float) -> Array:
        sway, roll = x[:2]
        ahead = math.sqrt(max(steady.speed**2 - sway**2, 0.0))
        alpha = steady.angle_of_attack
        velocity = np.array([ahead * math.cos(alpha), sway, ahead * math.sin(alpha)])
        motion = {"pitch": steady.pitch, "roll": roll, "turn_rate": rate}
        wrench = imbalance(vehicle, positions(x), velocity, **motion)
        return wrench[[0, *LATERAL]] / (vehicle.mass * vehicle.gravity)

    x: Array | None = np.array([0.0, 0.0, *(steady.command[free] / scale)])
    for rate in np.linspace(0.0, turn_rate, SLOWER_TURNS + 1)[1:]:
        assert x is not None
        x = newton(functools.partial(left_at, rate=float(rate)), x)
        if x is None:
            raise MissionError(
                f"vehicle {vehicle.name!r} has no steady turn of {math.degrees(turn_rate):.3g} "
                f"deg/s at {steady.speed:g} m/s"
            )
    assert x is not None
    found = positions(x)
    for i in free:
        part = vehicle.parts[i]
        if not part.low <= found[i] <= part.high:
            raise MissionError(
                f"vehicle {vehicle.name!r} has no turn of {math.degrees(turn_rate):.3g} deg/s at "
                f"{steady.speed:g} m/s: it takes the {part.name} at {part.text(found[i])}"
            )
    return found


@functools.lru_cache(maxsize=64)
def _usual_turn(vehicle: Vehicle) -> tuple[float, float]:
    """`turn_per_position` and speed [m/s] of the motion for which the file's gains are given.

    That is level motion at cruising speed, or the usual dive.
    """
    if vehicle.steered("speed") is not None:
        usual = level_way(vehicle, f"vehicle {vehicle.name!r}: its usual way", None)
    else:
        pitch, net_mass = vehicle.usual_glide
        pump = vehicle.steered("buoyancy")
        if pump is not None:
            net_mass = min(net_mass, vehicle.net_mass_for_pump(float(pump.low)))
        label, dive = f"vehicle {vehicle.name!r}: the usual dive", -math.degrees(pitch)
        usual = way(vehicle, label, "pitch_deg", dive, net_mass, None, within_travel=True)
    return turn_per_position(vehicle, usual), usual.speed
