"""Guidance: the segment state machine and its control loops, one compiled step.

Parts of the vehicle control its pitch (a battery slide, an elevator), its heading (a battery hinge,
a rudder), its weight (a pump) and its speed (a propeller). A pitch loop and a heading loop steer
dives, climbs and level legs. On a level leg a depth loop around them sets the pitch. In a hover the
pump holds the depth and the battery the pitch. Other parts hold the command of each phase.
`twin.mission` compiles a plan into the table that `guidance_step` reads. All memory is in the
caller's `state`, so the native plant, a Python loop and a copy of a simulation behave alike. Angles
are rad, depths m positive down, the frames are NED and FRD.

A loop works on the part's position times its sense: a slide moved forward pitches the nose down,
so its sense in pitch is -1. The lift decides to which side a rolled battery turns a glider. So the
heading loop takes its sense and strength from the row, separately for dives and climbs
(`twin.mission.turning`).
"""

from __future__ import annotations

import math

import numpy as np

from twin.compiled import borrowing, jit
from twin.mission import mission_file as g
from twin.mission.phases import advance
from twin.mission.reckoning import altitude_read, compass, heading_read, pid, reckon, wrapped
from twin.mission.stationing import hold_pose
from twin.numbers import Array

INTEGRAL_ZONE = math.radians(2.0)
"""[rad] Limit of the error in an integral, so that turns and inflections do not wind it up."""
DEPTH_ZONE = 1.0
"""[m] Limit of the depth error in an integral, so that an approach does not wind it up."""
UNDER_WAY = 0.02
"""[m/s] Vertical velocity above which a vehicle is moving vertically. Below, it is stuck (and the
depth integral acts to free it) or in an inflection."""
WAITING_ERROR = math.radians(60.0)
"""[rad] Heading error above which a turning setpoint waits for the vehicle."""
TURN_SIDE = math.radians(120.0)
"""[rad] Heading error above which a turn keeps the side to which it began."""
MIN_COS_PITCH = 0.2
"""[1] Lower bound of cos(pitch) in the heading rate, which is singular at 90 deg of pitch."""


@borrowing
def _copy_command(row, which, command):
    """Copy one of the row's three commands into `command`."""
    first = g.SEGMENT_COLUMNS + which * command.size
    for i in range(command.size):
        command[i] = row[first + i]


@borrowing
def _run_pitch_loop(part, sense, low, high, gains, first, state, slot, error, pitch_rate, command):
    """Run the pitch loop of one part about its position in the phase's command.

    Its three gains begin at gains[first].
    """
    place = int(part)
    if not 0 <= place < command.size:
        return
    low, high = sense * low, sense * high
    command[place] = sense * pid(
        gains, first, error, pitch_rate, sense * command[place],
        min(low, high), max(low, high), INTEGRAL_ZONE, state, slot,
    )  # fmt: skip


@borrowing
def _pitch_loop(row, gains, state, slot, error, pitch_rate, command):
    """Run the loop of the part that controls pitch."""
    part, sense = gains[g.PITCH_PART], gains[g.PITCH_SENSE]
    low, high = row[g.PITCH_LOW], row[g.PITCH_HIGH]
    first = g.PITCH_KP
    _run_pitch_loop(part, sense, low, high, gains, first, state, slot, error, pitch_rate, command)


@borrowing
def _trim_loop(gains, state, error, pitch_rate, command):
    """Run the loop of the battery that trims pitch in a hover, next to an elevator."""
    part, sense = gains[g.TRIM_PART], gains[g.TRIM_SENSE]
    low, high = gains[g.TRIM_LOW], gains[g.TRIM_HIGH]
    first, slot = g.TRIM_KP, g.TRIM_INTEGRAL
    _run_pitch_loop(part, sense, low, high, gains, first, state, slot, error, pitch_rate, command)


@borrowing
def _wanted_depth(row, depth, altitude):
    """Depth [m] of a level leg or hover: given, or from the given altitude above the sea floor."""
    wanted = row[g.DEPTH]
    if not math.isnan(row[g.ALTITUDE]):
        wanted = max(depth + altitude - row[g.ALTITUDE], row[g.MIN_DEPTH])
    if not math.isnan(row[g.MIN_ALTITUDE]):
        wanted = min(wanted, depth + altitude - row[g.MIN_ALTITUDE])
    return wanted


@borrowing
def _depth_pid(gains, first, state, slot, error, depth_rate, feedforward, low, high):
    """Run one tick of a loop that must go deeper by `error` [m]; its gains begin at gains[first].

    The integral is frozen while the vehicle approaches the depth from afar.
    """
    integral = state[slot]
    output = pid(gains, first, error, depth_rate, feedforward, low, high, DEPTH_ZONE, state, slot)
    if abs(error) > DEPTH_ZONE and abs(depth_rate) > UNDER_WAY:
        state[slot] = integral
    return output


@borrowing
def _level_pitch(row, gains, state, depth, altitude, depth_rate):
    """Pitch [rad] that takes the vehicle to the depth of a level leg and keeps it there."""
    error = _wanted_depth(row, depth, altitude) - depth
    level, low, high = -row[g.LEVEL_PITCH], -row[g.CLIMB_PITCH], -row[g.DIVE_PITCH]
    first, slot = g.DEPTH_KP, g.DEPTH_INTEGRAL
    return -_depth_pid(gains, first, state, slot, error, depth_rate, level, low, high)


@borrowing
def _buoyancy_loop(gains, state, wanted, depth, depth_rate, command):
    """Run the pump's loop that holds a depth without speed: with less volume the vehicle sinks."""
    part = int(gains[g.BUOYANCY_PART])
    if not 0 <= part < command.size:
        return
    error, neutral = wanted - depth, -command[part]
    low, high = -gains[g.BUOYANCY_HIGH], -gains[g.BUOYANCY_LOW]
    first, slot = g.BUOYANCY_KP, g.BUOYANCY_INTEGRAL
    command[part] = -_depth_pid(gains, first, state, slot, error, depth_rate, neutral, low, high)


@borrowing
def _leave_surface(gains, command):
    """Sink from the surface by weight, with pump and battery, if an elevator controls pitch.

    An elevator lifts the tail out of the water before it pitches the nose down, and a hull awash
    is stiff in pitch. At low speeds it would stay at the surface.
    """
    if gains[g.PITCHES_AT_REST] != 0.0:
        return
    pump, battery = int(gains[g.BUOYANCY_PART]), int(gains[g.TRIM_PART])
    if 0 <= pump < command.size:
        command[pump] = gains[g.BUOYANCY_LOW]
    if 0 <= battery < command.size:
        command[battery] = gains[g.TRIM_LOW if gains[g.TRIM_SENSE] > 0.0 else g.TRIM_HIGH]


@borrowing
def _moves_against_phase(row, gains, phase, depth_rate):
    """Tell whether a vehicle that turns by rolling does not yet sink in a dive, or rise in a climb.

    In an inflection, or at the start of a dive, its lift has the opposite sign or is zero. A loop
    with the phase's sign would then turn the vehicle away from its heading. As in real gliders, the
    battery keeps the roll that flies straight.
    """
    opposite = row[g.DIVE_TURN] * row[g.CLIMB_TURN] < 0.0
    if gains[g.TURNS_BY_ROLL] == 0.0 or phase == g.ON_LEVEL or not opposite:
        return False
    return (depth_rate if phase == g.DIVE else -depth_rate) < UNDER_WAY


@jit
def _move_followers(gains: Array, command: Array) -> None:
    """Move the followers of the parts that the loops have moved, within their travel."""
    wanted = command.copy()
    count = gains[g.FOLLOWERS]
    if not 0.0 <= count <= g.MOST_FOLLOWERS:  # not from `Mission.compile`
        return
    for k in range(int(count)):
        row = gains[g.FOLLOWER + k * g.FOLLOWER_COLUMNS :]
        if 0.0 <= row[0] < command.size and 0.0 <= row[1] < command.size:
            command[int(row[1])] += row[2] * (wanted[int(row[0])] - row[3])
    for k in range(int(count)):
        row = gains[g.FOLLOWER + k * g.FOLLOWER_COLUMNS :]
        if 0.0 <= row[1] < command.size:
            command[int(row[1])] = min(max(command[int(row[1])], row[4]), row[5])


@borrowing
def _has_fix(row, gains, state, depth):
    """Tell whether the vehicle has a GPS fix, which shows the surface if its depth gauge errs.

    `depth`: true depth [m].
    """
    highest = row[g.SURFACE_DEPTH]
    if state[g.PHASE] == g.CLIMB and row[g.MIN_DEPTH] < highest:
        highest = row[g.MIN_DEPTH]
    return bool(gains[g.DEPTH_OFFSET] != 0.0 and depth <= highest)


@borrowing
def _steer(
    table, gains, state, t, depth, roll, pitch, heading, p, q, r, command, altitude,
    north, east, current_north, current_east, fixed,
):  # fmt: skip
    """Run one tick like `guidance_step`, for the controlling parts without their followers."""
    heading = compass(heading_read(gains, heading))
    altitude = altitude_read(gains, state, t, altitude)
    row = table[min(max(int(state[g.SEGMENT]), 0), table.shape[0] - 1)]
    afloat = fixed != 0.0 or _has_fix(row, gains, state, depth)
    depth += gains[g.DEPTH_OFFSET]
    reckon(row, state, t, depth, pitch, heading, north, east, current_north, current_east)
    advance(table, state, t, depth, altitude, heading, afloat)
    row = table[min(max(int(state[g.SEGMENT]), 0), table.shape[0] - 1)]
    phase = state[g.PHASE]
    depth_rate = (depth - state[g.LAST_DEPTH]) / gains[g.PERIOD]
    state[g.LAST_DEPTH] = depth
    pitch_rate = q * math.cos(roll) - r * math.sin(roll)

    if phase == g.POSING or (phase == g.SURFACING and gains[g.THRUSTERS] > 0.0):
        state[g.PITCH_SETPOINT] = 0.0
        _copy_command(row, g.REST_COMMAND, command)
        hold_pose(
            row, gains, state, _wanted_depth(row, depth, altitude), depth, roll, pitch, heading,
            p, q, r, depth_rate, command,
        )  # fmt: skip
        return
    if phase in (g.HOLDING, g.AT_SURFACE):
        # no pitch loop at the surface either: without speed, nothing damps a closed loop
        state[g.PITCH_SETPOINT] = np.nan
        _copy_command(row, g.REST_COMMAND, command)
        return
    if phase == g.HOVERING:
        _copy_command(row, g.REST_COMMAND, command)
        setpoint = state[g.PITCH_SETPOINT] = row[g.LEVEL_PITCH]
        if gains[g.PITCHES_AT_REST] != 0.0:
            _pitch_loop(row, gains, state, g.LEVEL_INTEGRAL, setpoint - pitch, pitch_rate, command)
        _trim_loop(gains, state, setpoint - pitch, pitch_rate, command)
        wanted = _wanted_depth(row, depth, altitude)
        _buoyancy_loop(gains, state, wanted, depth, depth_rate, command)
        return

    # dive, climb and level leg keep separate integrals, because their trim errors differ
    if phase == g.ON_LEVEL:
        setpoint = _level_pitch(row, gains, state, depth, altitude, depth_rate)
        slot = g.LEVEL_INTEGRAL
        turn, turn_slot = row[g.LEVEL_TURN], g.LEVEL_TURN_INTEGRAL
        _copy_command(row, g.LEVEL_COMMAND, command)
    elif phase == g.DIVE:
        setpoint, slot = row[g.DIVE_PITCH], g.DIVE_INTEGRAL
        turn, turn_slot = row[g.DIVE_TURN], g.DIVE_TURN_INTEGRAL
        _copy_command(row, g.DIVE_COMMAND, command)
    else:
        setpoint, slot = row[g.CLIMB_PITCH], g.CLIMB_INTEGRAL
        turn, turn_slot = row[g.CLIMB_TURN], g.CLIMB_TURN_INTEGRAL
        _copy_command(row, g.CLIMB_COMMAND, command)
    state[g.PITCH_SETPOINT] = setpoint
    _pitch_loop(row, gains, state, slot, setpoint - pitch, pitch_rate, command)
    if setpoint < 0.0 and (afloat or depth < row[g.SURFACE_DEPTH]):
        _leave_surface(gains, command)

    part = int(gains[g.TURN_PART])
    if math.isnan(state[g.HEADING_SETPOINT]) or not 0 <= part < command.size:
        return
    error = wrapped(state[g.HEADING_SETPOINT] - heading)
    if phase == g.ON_LEVEL and row[g.TURN_RATE] != 0.0 and abs(error) < WAITING_ERROR:
        turned = state[g.HEADING_SETPOINT] + row[g.TURN_RATE] * gains[g.PERIOD]
        state[g.HEADING_SETPOINT] = compass(turned)
        error = wrapped(turned - heading)
    # a turn of half a circle stays on its side, although a yaw may make the other side shorter
    before = state[g.HEADING_ERROR]
    if before * error < 0.0 and abs(before) > TURN_SIDE and abs(error) > TURN_SIDE:
        error += math.copysign(2.0 * math.pi, before)
    state[g.HEADING_ERROR] = error
    heading_rate = (q * math.sin(roll) + r * math.cos(roll)) / max(math.cos(pitch), MIN_COS_PITCH)
    if phase == g.ON_LEVEL:
        heading_rate -= row[g.TURN_RATE]
    if not abs(turn) > 0.0:
        return
    if _moves_against_phase(row, gains, phase, depth_rate):
        error, heading_rate = 0.0, 0.0
    limit = row[g.TURN_LIMIT] / abs(turn)
    command[part] = turn * pid(
        gains, g.HEADING_KP, error, heading_rate, command[part] / turn,
        -limit, limit, INTEGRAL_ZONE, state, turn_slot,
    )  # fmt: skip


@borrowing
def guidance_step(
    table: Array,
    gains: Array,
    state: Array,
    t: float,
    depth: float,
    roll: float,
    pitch: float,
    heading: float,
    p: float,
    q: float,
    r: float,
    command: Array,
    altitude: float = math.inf,
    north: float = math.nan,
    east: float = math.nan,
    current_north: float = math.nan,
    current_east: float = math.nan,
    fixed: float = 0.0,
) -> None:
    """Run one control tick: read the vehicle's state, write `command` and update `state`.

    Args:
      table: (segments + 1, SEGMENT_COLUMNS + 3 parts) float64, from `Mission.compile`.
      gains: (GAINS,) float64, from `Mission.compile`.
      state: (GUIDANCE_STATE,) float64, zeros before the first tick; changed in place.
      t: [s] since the mission's start; one call per control period.
      depth: [m] of the CB, positive down.
      roll, pitch, heading: [rad]. The errors of the instruments in `gains` are added here to
        heading, depth and altitude.
      p, q, r: body rates [rad/s].
      command: (parts,) float64, out: the commanded position of each part.
      altitude: [m] of the CB above the sea floor, inf without a sea floor.
      north, east: [m] position of the vehicle, from a fix at the surface; NaN: no fixes.
      current_north, current_east: [m/s] estimate of a navigator, which then also gives north and
        east under water; NaN: no navigator, so guidance dead-reckons (`reckoning`).
      fixed: 1 if a receiver has a fix: the vehicle is at the surface whatever its gauge reads; 0:
        the depth alone decides.
    """
    _steer(
        table, gains, state, t, depth, roll, pitch, heading, p, q, r, command, altitude,
        north, east, current_north, current_east, fixed,
    )  # fmt: skip
    if gains[g.FOLLOWERS] > 0.0 and state[g.PHASE] != g.HOLDING:
        _move_followers(gains, command)


def new_state() -> Array:
    """Memory of guidance before its first tick, shape (GUIDANCE_STATE,)."""
    return np.zeros(g.GUIDANCE_STATE)
