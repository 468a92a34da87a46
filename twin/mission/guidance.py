"""Guidance: the segment state machine and the two decoupled PID loops, one compiled step.

One part of the vehicle controls pitch (a battery slide, an elevator), one controls heading (a
battery hinge, a rudder), and the others hold what each phase commands: the buoyancy engine is
heavy in a dive and light in a climb, a propeller drives. `twin.mission` compiles a plan into the
table that `guidance_step` reads; everything that it remembers lives in the caller's `state`, so
the native plant, a Python loop and a copy of a simulation behave alike. Angles are rad, depths m
positive down, the frame is NED and FRD.

A loop works on the part's position times its sense: a slide moved forward pitches the nose down,
so its sense in pitch is -1. Which way a rolled battery turns a glider depends on its lift, so the
heading loop takes its sense and strength from the row, for dives and climbs apart
(`twin.mission.turning`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit

Array = NDArray[np.float64]

# --- table: one row per segment; the last row is the end of the mission -----------------------
KIND = 0  # one of the kinds below
MIN_DEPTH, MAX_DEPTH = 1, 2  # [m] where a climb and a dive turn
DIVE_PITCH, CLIMB_PITCH = 3, 4  # [rad] signed: nose down is negative
HEADING = 5  # [rad], NaN: the heading at entry
PITCH_LOW, PITCH_HIGH = 6, 7  # travel of the pitching part
TURN_LIMIT = 8  # largest position of the turning part in the heading loop, either way
YO_LIMIT = 9  # NaN: none
DURATION = 10  # [s], NaN: none
UNTIL_DEPTH = 11  # [m], NaN: none
ABORT_DEPTH = 12  # [m], inf: none
SURFACE_DEPTH = 13  # [m] above this the vehicle counts as surfaced
DIVE_TURN, CLIMB_TURN = 14, 15  # factor of the heading loop, with the sign of the turn
MIN_ALTITUDE = 16  # [m] above the sea floor at which a dive turns, NaN: none
SEGMENT_COLUMNS = 17
# then three commands, each of the width of the vehicle: what its parts do in a dive, in a climb,
# and in a hold or at the surface. The loops start from the position of their part in it.
DIVE_COMMAND, CLIMB_COMMAND, REST_COMMAND = 0, 1, 2

SAW_TOOTH, SPIRAL, SURFACE, HOLD = 1.0, 2.0, 3.0, 4.0
END_AT_SURFACE, END_HOLDING = 5.0, 6.0  # kinds of the last row

# --- gains ------------------------------------------------------------------------------------
PITCH_KP, PITCH_KI, PITCH_KD = 0, 1, 2  # position per error [1/rad], [1/(rad s)], [s/rad]
HEADING_KP, HEADING_KI, HEADING_KD = 3, 4, 5  # likewise
PERIOD = 6  # [s]
PITCH_PART, PITCH_SENSE = 7, 8  # place among the parts, -1: none; +1 or -1
TURN_PART = 9  # place among the parts, -1: none
GAINS = 10

# --- state: all zeros before the first step ---------------------------------------------------
SEGMENT = 0  # index of the row being flown
PHASE = 1  # one of the phases below
YO_COUNT = 2  # of this segment, in halves; -0.5 while it finishes a climb it did not begin
SEGMENT_START = 3  # [s]
ARRIVAL = 4  # [s] time of reaching the surface
UNTIL_SIDE = 5  # +1: the segment ends below UNTIL_DEPTH, -1: above it
DIVE_INTEGRAL, CLIMB_INTEGRAL = 6, 7  # of pitch [rad s]
DIVE_TURN_INTEGRAL, CLIMB_TURN_INTEGRAL = 8, 9  # of heading [rad s]
PITCH_SETPOINT = 10  # [rad], NaN: none
HEADING_SETPOINT = 11  # [rad] in [0, 2 pi), NaN: none
DONE = 12  # 1 once the plan is flown, and the surface reached where it ends there
ABORTED = 13  # 1 once the abort depth was exceeded
HEADING_ERROR = 14  # [rad] of the last tick, by the side on which it turns
GUIDANCE_STATE = 15

NOT_STARTED, DIVE, CLIMB, SURFACING, AT_SURFACE, HOLDING = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0

INTEGRAL_ZONE = math.radians(2.0)
"""[rad] largest error that is integrated: turns and inflections must not wind the loops up."""
TURN_SIDE = math.radians(120.0)
"""[rad] errors beyond it keep the side that the turn began on."""
MIN_COS_PITCH = 0.2
"""Floor of cos(pitch) in the heading rate: it is singular at 90 deg, missions end below 60 deg."""
TIME_TOLERANCE = 1e-6
"""[s] a tick this close to a limit counts as on it: tick times are sums of rounded periods."""


@jit
def _at_bottom(row: Array, depth: float, altitude: float) -> bool:
    """Whether a dive turns here: at its depth, or near the sea floor."""
    return bool(depth >= row[MAX_DEPTH] or altitude <= row[MIN_ALTITUDE])


@jit
def _enter(
    table: Array,
    state: Array,
    index: int,
    t: float,
    depth: float,
    altitude: float,
    heading: float,
) -> None:
    """Make row `index` the current segment and choose its first phase."""
    previous = state[PHASE]
    index = min(max(index, 0), table.shape[0] - 1)
    kind = table[index, KIND]
    state[SEGMENT] = index
    state[SEGMENT_START] = t
    state[YO_COUNT] = 0.0
    state[UNTIL_SIDE] = 1.0 if table[index, UNTIL_DEPTH] > depth else -1.0
    state[DIVE_TURN_INTEGRAL] = state[CLIMB_TURN_INTEGRAL] = state[HEADING_ERROR] = 0.0
    target = table[index, HEADING]
    state[HEADING_SETPOINT] = heading if math.isnan(target) else target
    if kind == HOLD:
        state[PHASE] = HOLDING
        state[HEADING_SETPOINT] = np.nan
    elif kind in (SAW_TOOTH, SPIRAL):
        climbing = previous == CLIMB and depth > table[index, MIN_DEPTH]
        if climbing or _at_bottom(table[index], depth, altitude):
            state[PHASE] = CLIMB
            state[YO_COUNT] = -0.5
        else:
            state[PHASE] = DIVE
        if kind == SPIRAL:
            state[HEADING_SETPOINT] = np.nan
    else:
        state[PHASE] = SURFACING


@jit
def _advance(
    table: Array, state: Array, t: float, depth: float, altitude: float, heading: float
) -> None:
    """Phases and segments: turn at the limits of depth and altitude, count, go on, abort."""
    end = table.shape[0] - 1
    if state[PHASE] == NOT_STARTED:
        _enter(table, state, 0, t, depth, altitude, heading)
    index = min(max(int(state[SEGMENT]), 0), end)
    if depth > table[index, ABORT_DEPTH] and index < end:
        state[ABORTED] = 1.0
        index = end
        _enter(table, state, index, t, depth, altitude, heading)

    phase = state[PHASE]
    following = phase
    if phase == DIVE and _at_bottom(table[index], depth, altitude):
        following = CLIMB
        state[YO_COUNT] += 0.5
    elif phase == CLIMB and depth <= table[index, MIN_DEPTH]:
        following = DIVE
        state[YO_COUNT] += 0.5
    elif phase == SURFACING and depth <= table[index, SURFACE_DEPTH]:
        following = AT_SURFACE
        state[ARRIVAL] = t
        if index == end:
            state[DONE] = 1.0

    if index < end and state[DONE] == 0.0:
        duration = table[index, DURATION]
        if table[index, KIND] == SURFACE:
            over = following == AT_SURFACE and t - state[ARRIVAL] >= duration - TIME_TOLERANCE
        else:
            over = t - state[SEGMENT_START] >= duration - TIME_TOLERANCE
        over = over or state[YO_COUNT] >= table[index, YO_LIMIT]
        over = over or (depth - table[index, UNTIL_DEPTH]) * state[UNTIL_SIDE] >= 0.0
        if over and index + 1 == end and table[end, KIND] == END_HOLDING:
            state[DONE] = 1.0  # the last segment goes on without limits
        elif over:
            _enter(table, state, index + 1, t, depth, altitude, heading)
            return
    state[PHASE] = following


@jit
def _pid(
    kp: float,
    ki: float,
    kd: float,
    error: float,
    rate: float,
    feedforward: float,
    low: float,
    high: float,
    period: float,
    state: Array,
    slot: int,
) -> float:
    """One PID tick with the derivative on the measured rate; returns the clamped output.

    The integral of the error, limited to INTEGRAL_ZONE, is kept in state[slot] and stands still
    while the output is clamped and the error pushes further out.
    """
    output = feedforward + kp * error + ki * state[slot] - kd * rate
    clamped = min(max(output, low), high)
    if (output - clamped) * error * ki <= 0.0:
        state[slot] += period * min(max(error, -INTEGRAL_ZONE), INTEGRAL_ZONE)
    return clamped


@jit
def _command(row: Array, which: int, command: Array) -> None:
    """Copy one of the row's three commands."""
    first = SEGMENT_COLUMNS + which * command.size
    for i in range(command.size):
        command[i] = row[first + i]


@jit
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
) -> None:
    """One control tick: reads the vehicle's state, writes `command` and updates `state`.

    Args:
      table: (segments + 1, SEGMENT_COLUMNS + 3 parts) float64, from `Mission.compile`.
      gains: (GAINS,) float64, from `Mission.compile`.
      state: (GUIDANCE_STATE,) float64, zeros before the first tick; changed in place.
      t: [s] since the mission's start; call once per control period.
      depth: [m] of the CB, positive down.
      roll, pitch, heading: [rad].
      p, q, r: body rates [rad/s].
      command: (parts,) float64, out: the wanted position of each part.
      altitude: [m] of the CB above the sea floor, inf without one.
    """
    _advance(table, state, t, depth, altitude, heading)
    row = table[min(max(int(state[SEGMENT]), 0), table.shape[0] - 1)]
    phase = state[PHASE]

    if phase in (HOLDING, AT_SURFACE):
        # at the surface open loop too: without speed there is no damping to close a loop around
        state[PITCH_SETPOINT] = np.nan
        _command(row, REST_COMMAND, command)
        return

    # each way keeps its own integrals: the trim error of a dive is not that of a climb
    if phase == DIVE:
        setpoint, slot = row[DIVE_PITCH], DIVE_INTEGRAL
        turn, turn_slot = row[DIVE_TURN], DIVE_TURN_INTEGRAL
        _command(row, DIVE_COMMAND, command)
    else:
        setpoint, slot = row[CLIMB_PITCH], CLIMB_INTEGRAL
        turn, turn_slot = row[CLIMB_TURN], CLIMB_TURN_INTEGRAL
        _command(row, CLIMB_COMMAND, command)
    state[PITCH_SETPOINT] = setpoint
    part = int(gains[PITCH_PART])
    if 0 <= part < command.size:
        sense = gains[PITCH_SENSE]
        low, high = sense * row[PITCH_LOW], sense * row[PITCH_HIGH]
        pitch_rate = q * math.cos(roll) - r * math.sin(roll)
        command[part] = sense * _pid(
            gains[PITCH_KP],
            gains[PITCH_KI],
            gains[PITCH_KD],
            setpoint - pitch,
            pitch_rate,
            sense * command[part],
            min(low, high),
            max(low, high),
            gains[PERIOD],
            state,
            slot,
        )

    part = int(gains[TURN_PART])
    if math.isnan(state[HEADING_SETPOINT]) or not 0 <= part < command.size:
        return
    error = state[HEADING_SETPOINT] - heading
    error -= 2.0 * math.pi * math.floor(error / (2.0 * math.pi) + 0.5)
    # a turn of half a circle stays on its side, whichever way a yaw makes shorter
    before = state[HEADING_ERROR]
    if before * error < 0.0 and abs(before) > TURN_SIDE and abs(error) > TURN_SIDE:
        error += math.copysign(2.0 * math.pi, before)
    state[HEADING_ERROR] = error
    heading_rate = (q * math.sin(roll) + r * math.cos(roll)) / max(math.cos(pitch), MIN_COS_PITCH)
    if not abs(turn) > 0.0:
        return
    limit = row[TURN_LIMIT] / abs(turn)
    command[part] = turn * _pid(
        gains[HEADING_KP],
        gains[HEADING_KI],
        gains[HEADING_KD],
        error,
        heading_rate,
        command[part] / turn,
        -limit,
        limit,
        gains[PERIOD],
        state,
        turn_slot,
    )


def new_state() -> Array:
    """The memory of a guidance that has not started, shape (GUIDANCE_STATE,)."""
    return np.zeros(GUIDANCE_STATE)
