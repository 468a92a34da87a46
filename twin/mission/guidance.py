"""Guidance: the segment state machine and the two decoupled PID loops, one compiled step.

The battery's shift controls pitch, its rotation controls heading, and the buoyancy engine
switches between heavy and light, as in the paper. `twin.mission` compiles a plan into the table
that `guidance_step` reads; everything that it remembers lives in the caller's `state`, so the
native plant, a Python loop and a copy of a simulation behave alike. Angles are rad, depths m
positive down, the frame is NED and FRD.

Positive shift moves the battery forward and pitches the nose down, hence the minus sign in the
pitch loop. Positive rotation turns to starboard in a dive and in a climb (a glider that rolls to
port turns to starboard both ways), so the heading loop keeps its sign.
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
DIVE_SHIFT, CLIMB_SHIFT = 5, 6  # [m] trim at these pitches, fed forward; of a hold and at the
# surface the position itself
DIVE_PUMP, CLIMB_PUMP = 7, 8  # [cm3]
HEADING = 9  # [rad], NaN: the heading at entry
DIVE_ROTATION, CLIMB_ROTATION = 10, 11  # [rad] of a spiral or a hold
MAX_ROTATION = 12  # [rad] limit of the heading loop
YO_LIMIT = 13  # NaN: none
DURATION = 14  # [s], NaN: none
UNTIL_DEPTH = 15  # [m], NaN: none
ABORT_DEPTH = 16  # [m], inf: none
SURFACE_DEPTH = 17  # [m] above this the glider counts as surfaced
SHIFT_MIN, SHIFT_MAX = 18, 19  # [m]
SEGMENT_COLUMNS = 20

SAW_TOOTH, SPIRAL, SURFACE, HOLD = 1.0, 2.0, 3.0, 4.0
END_AT_SURFACE, END_HOLDING = 5.0, 6.0  # kinds of the last row

# --- gains ------------------------------------------------------------------------------------
PITCH_KP, PITCH_KI, PITCH_KD = 0, 1, 2  # [m/rad], [m/(rad s)], [m s/rad]
HEADING_KP, HEADING_KI, HEADING_KD = 3, 4, 5  # [1], [1/s], [s]
PERIOD = 6  # [s]
GAINS = 7

# --- state: all zeros before the first step ---------------------------------------------------
SEGMENT = 0  # index of the row being flown
PHASE = 1  # one of the phases below
YO_COUNT = 2  # of this segment, in halves; -0.5 while it finishes a climb it did not begin
SEGMENT_START = 3  # [s]
ARRIVAL = 4  # [s] time of reaching the surface
UNTIL_SIDE = 5  # +1: the segment ends below UNTIL_DEPTH, -1: above it
DIVE_INTEGRAL, CLIMB_INTEGRAL, HEADING_INTEGRAL = 6, 7, 8  # [rad s]
PITCH_SETPOINT = 9  # [rad], NaN: none
HEADING_SETPOINT = 10  # [rad] in [0, 2 pi), NaN: none
DONE = 11  # 1 once the plan is flown, and the surface reached where it ends there
ABORTED = 12  # 1 once the abort depth was exceeded
GUIDANCE_STATE = 13

NOT_STARTED, DIVE, CLIMB, SURFACING, AT_SURFACE, HOLDING = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0

INTEGRAL_ZONE = math.radians(2.0)
"""[rad] largest error that is integrated: turns and inflections must not wind the loops up."""
MIN_COS_PITCH = 0.2
"""Floor of cos(pitch) in the heading rate: it is singular at 90 deg, missions end below 60 deg."""
TIME_TOLERANCE = 1e-6
"""[s] a tick this close to a limit counts as on it: tick times are sums of rounded periods."""


@jit
def _enter(table: Array, state: Array, index: int, t: float, depth: float, heading: float) -> None:
    """Make row `index` the current segment and choose its first phase."""
    previous = state[PHASE]
    kind = table[index, KIND]
    state[SEGMENT] = index
    state[SEGMENT_START] = t
    state[YO_COUNT] = 0.0
    state[UNTIL_SIDE] = 1.0 if table[index, UNTIL_DEPTH] > depth else -1.0
    state[HEADING_INTEGRAL] = 0.0
    target = table[index, HEADING]
    state[HEADING_SETPOINT] = heading if math.isnan(target) else target
    if kind == HOLD:
        state[PHASE] = HOLDING
        state[HEADING_SETPOINT] = np.nan
    elif kind in (SAW_TOOTH, SPIRAL):
        climbing = previous == CLIMB and depth > table[index, MIN_DEPTH]
        if climbing or depth >= table[index, MAX_DEPTH]:
            state[PHASE] = CLIMB
            state[YO_COUNT] = -0.5
        else:
            state[PHASE] = DIVE
        if kind == SPIRAL:
            state[HEADING_SETPOINT] = np.nan
    else:
        state[PHASE] = SURFACING


@jit
def _advance(table: Array, state: Array, t: float, depth: float, heading: float) -> None:
    """Phases and segments: turn at the depth limits, count, go on, abort."""
    end = table.shape[0] - 1
    if state[PHASE] == NOT_STARTED:
        _enter(table, state, 0, t, depth, heading)
    index = int(state[SEGMENT])
    if depth > table[index, ABORT_DEPTH] and index < end:
        state[ABORTED] = 1.0
        index = end
        _enter(table, state, index, t, depth, heading)

    phase = state[PHASE]
    following = phase
    if phase == DIVE and depth >= table[index, MAX_DEPTH]:
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
            _enter(table, state, index + 1, t, depth, heading)
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
    shift: float,
    rotation: float,
    pump: float,
    command: Array,
) -> None:
    """One control tick: reads the vehicle's state, writes `command` and updates `state`.

    Args:
      table: (segments + 1, SEGMENT_COLUMNS) float64, from `Mission.compile`.
      gains: (GAINS,) float64, from `Mission.compile`.
      state: (GUIDANCE_STATE,) float64, zeros before the first tick; changed in place.
      t: [s] since the mission's start; call once per control period.
      depth: [m] of the CB, positive down.
      roll, pitch, heading: [rad].
      p, q, r: body rates [rad/s].
      shift, rotation, pump: actuator positions [m], [rad], [cm3]; these two loops do not need
        them, other laws behind the same call may.
      command: (3,) float64, out: shift [m], rotation [rad], pump [cm3].
    """
    _advance(table, state, t, depth, heading)
    row = table[int(state[SEGMENT])]
    phase = state[PHASE]

    if phase == HOLDING:
        state[PITCH_SETPOINT] = np.nan
        command[0], command[1], command[2] = row[DIVE_SHIFT], row[DIVE_ROTATION], row[DIVE_PUMP]
        return
    if phase == AT_SURFACE:  # open loop: without speed there is no damping to close a loop around
        state[PITCH_SETPOINT] = np.nan
        command[0], command[1], command[2] = row[DIVE_SHIFT], 0.0, row[CLIMB_PUMP]
        return

    # each way keeps its own integral: the trim error of a dive is not that of a climb
    if phase == DIVE:
        setpoint, feedforward, slot = row[DIVE_PITCH], row[DIVE_SHIFT], DIVE_INTEGRAL
        command[2], fixed_rotation = row[DIVE_PUMP], row[DIVE_ROTATION]
    else:
        setpoint, feedforward, slot = row[CLIMB_PITCH], row[CLIMB_SHIFT], CLIMB_INTEGRAL
        command[2], fixed_rotation = row[CLIMB_PUMP], row[CLIMB_ROTATION]
    state[PITCH_SETPOINT] = setpoint
    pitch_rate = q * math.cos(roll) - r * math.sin(roll)
    command[0] = -_pid(
        gains[PITCH_KP],
        gains[PITCH_KI],
        gains[PITCH_KD],
        setpoint - pitch,
        pitch_rate,
        -feedforward,
        -row[SHIFT_MAX],
        -row[SHIFT_MIN],
        gains[PERIOD],
        state,
        slot,
    )

    if math.isnan(state[HEADING_SETPOINT]):
        command[1] = fixed_rotation
        return
    error = state[HEADING_SETPOINT] - heading
    error -= 2.0 * math.pi * math.floor(error / (2.0 * math.pi) + 0.5)
    heading_rate = (q * math.sin(roll) + r * math.cos(roll)) / max(math.cos(pitch), MIN_COS_PITCH)
    command[1] = _pid(
        gains[HEADING_KP],
        gains[HEADING_KI],
        gains[HEADING_KD],
        error,
        heading_rate,
        0.0,
        -row[MAX_ROTATION],
        row[MAX_ROTATION],
        gains[PERIOD],
        state,
        HEADING_INTEGRAL,
    )


def new_state() -> Array:
    """The memory of a guidance that has not started, shape (GUIDANCE_STATE,)."""
    return np.zeros(GUIDANCE_STATE)
