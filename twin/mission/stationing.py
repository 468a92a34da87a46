"""Stationing: the loops by which thrusters hold and move a hull's pose, one compiled tick.

A reference point moves to the target at the segment's speed, and a reference depth at DEPTH_RATE.
PID loops push the hull towards both, in north, east and down, and turn it to its heading and level.
The wanted force is turned into body axes by the attitude, so that it holds upside down as well. Its
share of each thruster is `twin.vehicle.assembly.thrust_weights`. Moments and the vertical come
first; the horizontal force is shortened to what the thrusters have left. The thrust curve and its
dead band are inverted (`twin.vehicle.parts.thruster`).
"""

from __future__ import annotations

import math

import numpy as np

from twin.compiled import borrowing
from twin.mission import mission_file as g
from twin.mission.reckoning import compass, wrapped
from twin.vehicle.assembly import MOST_THRUSTERS

DEPTH_RATE = 0.3
"""[m/s] Vertical speed of the reference depth."""
ZONE = 0.5
"""[m], [rad] Limit of the error in an integral."""
SMALL = 0.002
"""[1] Share of the full thrust below which the command is linear through the dead band."""


@borrowing
def begin_station(row, state, depth):
    """Begin a pose at the place where the vehicle is, with empty integrals."""
    for slot in range(g.NORTH_INTEGRAL, g.YAW_INTEGRAL + 1):
        state[slot] = 0.0
    state[g.REFERENCE_NORTH] = state[g.LAST_NORTH] = state[g.SEEN_NORTH]
    state[g.REFERENCE_EAST] = state[g.LAST_EAST] = state[g.SEEN_EAST]
    state[g.REFERENCE_DEPTH] = depth


@borrowing
def reference_there(row, state):
    """Tell whether the reference point is at the row's target; False without a target."""
    north, east = row[g.TARGET_NORTH], row[g.TARGET_EAST]
    return bool(state[g.REFERENCE_NORTH] == north and state[g.REFERENCE_EAST] == east)


@borrowing
def _moved_reference(row, gains, state):
    """Move the reference point by one tick; returns its velocity north and east [m/s]."""
    north = row[g.TARGET_NORTH] - state[g.REFERENCE_NORTH]
    east = row[g.TARGET_EAST] - state[g.REFERENCE_EAST]
    distance = math.sqrt(north * north + east * east)
    if not distance > 0.0:  # also without a target
        return 0.0, 0.0
    step = row[g.LEVEL_SPEED] * gains[g.PERIOD]
    if distance <= step:
        state[g.REFERENCE_NORTH] = row[g.TARGET_NORTH]
        state[g.REFERENCE_EAST] = row[g.TARGET_EAST]
        return 0.0, 0.0
    north, east = north / distance, east / distance
    state[g.REFERENCE_NORTH] += step * north
    state[g.REFERENCE_EAST] += step * east
    return row[g.LEVEL_SPEED] * north, row[g.LEVEL_SPEED] * east


@borrowing
def _pid(gains, first, error, rate_error, state, slot, axis):
    """Force or moment for an axis; its three gains begin at gains[first].

    The integral gives at most the thrusters' largest force or moment on that axis.
    """
    integral = state[slot] + gains[g.PERIOD] * min(max(error, -ZONE), ZONE)
    most = gains[g.AUTHORITY + axis]
    if abs(gains[first + 1] * integral) <= most or abs(integral) < abs(state[slot]):
        state[slot] = integral
    found = gains[first] * error + gains[first + 1] * state[slot]
    return found + gains[first + 2] * rate_error


@borrowing
def _command(gains, first, thrust):
    """Command of a thruster for a thrust [N] at rest; its numbers begin at gains[first]."""
    share = thrust / gains[first + 7] if thrust >= 0.0 else -thrust / gains[first + 8]
    dead, curve = gains[first + 9], gains[first + 10]
    used = min(max(share, SMALL), 1.0)
    part = used
    if curve > 0.0:
        part = (math.sqrt((1.0 - curve) ** 2 + 4.0 * curve * used) - 1.0 + curve) / (2.0 * curve)
    found = dead + (1.0 - dead) * part
    if share < SMALL:
        found *= share / SMALL
    return found if thrust >= 0.0 else -found


@borrowing
def _push(gains, first_x, first_y, first_z, k, m, n, x, y, z, command):
    """Share a wrench, body FRD about the CB, among the thrusters: write their commands.

    `x`, `y`, `z` is the part of the force that is shortened.
    """
    share, count = 1.0, int(min(max(gains[g.THRUSTERS], 0.0), MOST_THRUSTERS))
    for i in range(count):
        w = gains[g.THRUSTER + i * g.THRUSTER_COLUMNS :]
        rest = w[1] * first_x + w[2] * first_y + w[3] * first_z + w[4] * k + w[5] * m + w[6] * n
        extra = w[1] * x + w[2] * y + w[3] * z
        if extra > 0.0:
            share = min(share, max(w[7] - rest, 0.0) / extra)
        elif extra < 0.0:
            share = min(share, max(w[8] + rest, 0.0) / -extra)
    for i in range(count):
        first = g.THRUSTER + i * g.THRUSTER_COLUMNS
        w = gains[first:]
        part = int(w[0])
        if 0 <= part < command.size:
            thrust = w[1] * (first_x + share * x) + w[2] * (first_y + share * y)
            thrust += w[3] * (first_z + share * z) + w[4] * k + w[5] * m + w[6] * n
            command[part] = _command(gains, first, thrust)


share_wrench = _push
"""Share a wrench among the thrusters, for pilots in Python."""


@borrowing
def hold_pose(
    row, gains, state, wanted, depth, roll, pitch, heading, p, q, r, depth_rate, command
):  # fmt: skip
    """Run one tick of all loops and write the thrusters' commands.

    Args:
      wanted: [m] depth to go to, NaN: the depth at the segment's start.
    """
    period = gains[g.PERIOD]
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    ch, sh = math.cos(heading), math.sin(heading)

    # depth: a stick moves the vehicle; without one the loop holds
    lift, down, fall = 0.0, 0.0, 0.0
    if row[g.STICK_HEAVE] != 0.0 and not math.isnan(row[g.STICK_HEAVE]):
        state[g.REFERENCE_DEPTH] = depth
        lift = row[g.STICK_HEAVE] * gains[g.AUTHORITY + 2]
        lift += gains[g.STATION_KP + 4] * state[g.DOWN_INTEGRAL]
    else:
        if not math.isnan(wanted):
            step = wanted - state[g.REFERENCE_DEPTH]
            step = min(max(step, -DEPTH_RATE * period), DEPTH_RATE * period)
            state[g.REFERENCE_DEPTH] += step
            fall = step / period
        error = state[g.REFERENCE_DEPTH] - depth
        down = _pid(gains, g.STATION_KP + 3, error, fall - depth_rate, state, g.DOWN_INTEGRAL, 2)

    north = east = ahead = aside = 0.0
    if row[g.KIND] == g.STICKS:
        ahead = row[g.STICK_SURGE] * gains[g.AUTHORITY]
        aside = row[g.STICK_SWAY] * gains[g.AUTHORITY + 1]
    elif row[g.KIND] == g.POSE:
        speed_north, speed_east = _moved_reference(row, gains, state)
        speed_north -= (state[g.SEEN_NORTH] - state[g.LAST_NORTH]) / period
        speed_east -= (state[g.SEEN_EAST] - state[g.LAST_EAST]) / period
        error = state[g.REFERENCE_NORTH] - state[g.SEEN_NORTH]
        north = _pid(gains, g.STATION_KP, error, speed_north, state, g.NORTH_INTEGRAL, 0)
        error = state[g.REFERENCE_EAST] - state[g.SEEN_EAST]
        east = _pid(gains, g.STATION_KP, error, speed_east, state, g.EAST_INTEGRAL, 0)
    state[g.LAST_NORTH], state[g.LAST_EAST] = state[g.SEEN_NORTH], state[g.SEEN_EAST]

    turn = 0.0 if math.isnan(row[g.TURN_RATE]) else row[g.TURN_RATE]
    state[g.HEADING_SETPOINT] = compass(state[g.HEADING_SETPOINT] + turn * period)
    error = wrapped(state[g.HEADING_SETPOINT] - heading)
    n = _pid(gains, g.STATION_KP + 6, error, turn - r, state, g.YAW_INTEGRAL, 5)
    k = _pid(gains, g.STATION_KP + 9, -roll, -p, state, g.ROLL_INTEGRAL, 3)
    m = _pid(gains, g.STATION_KP + 9, -pitch, -q, state, g.TILT_INTEGRAL, 4)

    level_ahead, level_aside = ch * north + sh * east, ch * east - sh * north
    x = cp * level_ahead + ahead
    y = sr * sp * level_ahead + cr * level_aside + aside
    z = cr * sp * level_ahead - sr * level_aside
    _push(gains, -sp * down, sr * cp * down, cr * cp * down + lift, k, m, n, x, y, z, command)


def thruster_gains(vehicle, gains):
    """Write the thrusters' gains of a vehicle that holds a pose into its gains (GAINS,)."""
    if not vehicle.holds_pose:
        return
    weights = vehicle.thrust_weights
    gains[g.STATION_KP : g.STATION_KP + 12] = vehicle.station_pid
    turned = [k for k, part in enumerate(vehicle.parts) if np.any(weights[k])]
    gains[g.THRUSTERS] = len(turned)
    for i, k in enumerate(turned):
        part, first = vehicle.parts[k], g.THRUSTER + i * g.THRUSTER_COLUMNS
        gains[first : first + g.THRUSTER_COLUMNS] = (
            *(k, *weights[k], part.ahead, part.astern, part.dead_band, part.curvature),
        )
    least = np.array([min(vehicle.parts[k].ahead, vehicle.parts[k].astern) for k in turned])
    share = np.abs(weights[turned]) / least[:, None]
    most = share.max(axis=0)
    gains[g.AUTHORITY : g.AUTHORITY + 6] = np.divide(1.0, most, out=np.zeros(6), where=most > 1e-6)
