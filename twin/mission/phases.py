"""Phases: compiled logic that turns dives, ends and begins segments, and aborts a mission."""

from __future__ import annotations

import math

import numpy as np

from twin.compiled import borrowing
from twin.mission import mission_file as g
from twin.mission.reckoning import course, distance_left
from twin.mission.stationing import begin_station, reference_there

TIME_TOLERANCE = 1e-6
"""[s] Tolerance of time limits, because tick times are sums of rounded periods."""


@borrowing
def _at_bottom(row, depth, altitude):
    """Tell whether a dive turns here: at its depth, or near the sea floor."""
    return bool(depth >= row[g.MAX_DEPTH] or altitude <= row[g.MIN_ALTITUDE])


@borrowing
def _enter(table, state, index, t, depth, altitude, heading):
    """Make row `index` the current segment and choose its first phase."""
    previous = state[g.PHASE]
    index = min(max(index, 0), table.shape[0] - 1)
    kind = table[index, g.KIND]
    state[g.SEGMENT] = index
    state[g.SEGMENT_START] = t
    state[g.YO_COUNT] = 0.0
    state[g.UNTIL_SIDE] = 1.0 if table[index, g.UNTIL_DEPTH] > depth else -1.0
    state[g.DIVE_TURN_INTEGRAL] = state[g.CLIMB_TURN_INTEGRAL] = state[g.HEADING_ERROR] = 0.0
    state[g.LEVEL_TURN_INTEGRAL] = 0.0
    target = table[index, g.HEADING]
    state[g.HEADING_SETPOINT] = heading if math.isnan(target) else target
    if kind == g.HOLD:
        state[g.PHASE] = g.HOLDING
        state[g.HEADING_SETPOINT] = np.nan
    elif kind == g.HOVER:
        state[g.PHASE] = g.HOVERING
        state[g.HEADING_SETPOINT] = np.nan
        state[g.BUOYANCY_INTEGRAL] = state[g.TRIM_INTEGRAL] = 0.0
    elif kind in (g.POSE, g.STICKS):
        state[g.PHASE], state[g.ARRIVED] = g.POSING, 0.0
        if previous != g.POSING:
            begin_station(table[index], state, depth)
    elif kind == g.LEVEL:
        state[g.PHASE] = g.ON_LEVEL
        state[g.DEPTH_INTEGRAL] = 0.0
    elif kind in (g.SAW_TOOTH, g.SPIRAL, g.WAYPOINT):
        climbing = previous == g.CLIMB and depth > table[index, g.MIN_DEPTH]
        if climbing or _at_bottom(table[index], depth, altitude):
            state[g.PHASE] = g.CLIMB
            state[g.YO_COUNT] = -0.5
        else:
            state[g.PHASE] = g.DIVE
        if kind == g.SPIRAL:
            state[g.HEADING_SETPOINT] = np.nan
        elif kind == g.WAYPOINT:
            state[g.ARRIVED] = 0.0
            north, east = table[index, g.FIRST_CURRENT_NORTH], table[index, g.FIRST_CURRENT_EAST]
            if state[g.CURRENT_KNOWN] == 0.0 and not math.isnan(north + east):
                state[g.CURRENT_NORTH], state[g.CURRENT_EAST] = north, east
            state[g.HEADING_SETPOINT] = course(table[index], state)
    else:
        state[g.PHASE] = g.SURFACING
        if previous != g.POSING:
            begin_station(table[index], state, depth)


@borrowing
def _must_surface(row, state, t, following):
    """True if a flight to a waypoint surfaces now: by time, by yos or on arrival.

    `following`: next phase, after the turns at the largest and the least depth.
    """
    if state[g.ARRIVED] != 0.0:
        return bool(row[g.SURFACE_AT_TARGET] != 0.0)
    if t - state[g.LAST_FIX] >= row[g.SURFACE_AFTER] - TIME_TOLERANCE:
        return True
    turned = state[g.PHASE] == g.CLIMB and following == g.DIVE
    return bool(turned and state[g.YOS_UNDER] >= row[g.SURFACE_YOS])


@borrowing
def _waypoint_phase(row, state, t, following):
    """Phase of a flight to a waypoint: surfaces for a fix, dives again, updates the course."""
    phase = state[g.PHASE]
    # a mission that is done and holds its last segment keeps approaching the target
    if state[g.DONE] == 0.0 and distance_left(row, state) <= row[g.ARRIVAL_RADIUS]:
        state[g.ARRIVED] = 1.0
    if phase in (g.DIVE, g.CLIMB):
        if _must_surface(row, state, t, following):
            return g.SURFACING
        if row[g.STEERS_ALWAYS] != 0.0 and state[g.ARRIVED] == 0.0:
            state[g.HEADING_SETPOINT] = course(row, state)
    elif phase == g.AT_SURFACE and t - state[g.ARRIVAL] >= row[g.STAY] - TIME_TOLERANCE:
        state[g.HEADING_ERROR] = 0.0
        state[g.HEADING_SETPOINT] = course(row, state)
        return g.DIVE
    return following


@borrowing
def _stayed(row, state, t):
    """Tell whether a pose's stay at its target is over; the vehicle passes a target without one."""
    if state[g.ARRIVED] == 0.0 and reference_there(row, state):
        if not row[g.STAY] > 0.0:
            return True
        if distance_left(row, state) <= row[g.ARRIVAL_RADIUS]:
            state[g.ARRIVED], state[g.ARRIVAL] = 1.0, t
    return bool(state[g.ARRIVED] != 0.0 and t - state[g.ARRIVAL] >= row[g.STAY] - TIME_TOLERANCE)


@borrowing
def advance(table, state, t, depth, altitude, heading, afloat):
    """Advance phase and segment: turn at limits of depth and altitude, count yos, go on, abort.

    `afloat`: the vehicle is known to be at the surface, so that a climb ends at any depth reading.
    """
    end = table.shape[0] - 1
    if state[g.PHASE] == g.NOT_STARTED:
        state[g.LAST_DEPTH] = depth
        _enter(table, state, 0, t, depth, altitude, heading)
    index = min(max(int(state[g.SEGMENT]), 0), end)
    if depth > table[index, g.ABORT_DEPTH] and index < end:
        state[g.ABORTED] = 1.0
        index = end
        _enter(table, state, index, t, depth, altitude, heading)

    phase = state[g.PHASE]
    following = phase
    if phase == g.DIVE and _at_bottom(table[index], depth, altitude):
        following = g.CLIMB
        state[g.YO_COUNT] += 0.5
        state[g.YOS_UNDER] += 0.5
    elif phase == g.CLIMB and (afloat or depth <= table[index, g.MIN_DEPTH]):
        following = g.DIVE
        state[g.YO_COUNT] += 0.5
        state[g.YOS_UNDER] += 0.5
    elif phase == g.SURFACING and (afloat or depth <= table[index, g.SURFACE_DEPTH]):
        following = g.AT_SURFACE
        state[g.ARRIVAL] = t
        state[g.YOS_UNDER] = 0.0
        if index == end:
            state[g.DONE] = 1.0
    there = False
    if table[index, g.KIND] == g.WAYPOINT:
        following = _waypoint_phase(table[index], state, t, following)
        there = state[g.ARRIVED] != 0.0 and following != g.SURFACING
        # surface for a fix first, then go on to the next target
        there = there and following != g.AT_SURFACE
    elif table[index, g.KIND] == g.POSE:
        there = _stayed(table[index], state, t)

    if index < end and state[g.DONE] == 0.0:
        duration = table[index, g.DURATION]
        if table[index, g.KIND] == g.SURFACE:
            over = following == g.AT_SURFACE and t - state[g.ARRIVAL] >= duration - TIME_TOLERANCE
        else:
            over = t - state[g.SEGMENT_START] >= duration - TIME_TOLERANCE
        over = over or there or state[g.YO_COUNT] >= table[index, g.YO_LIMIT]
        until = table[index, g.UNTIL_DEPTH]
        over = over or (depth - until) * state[g.UNTIL_SIDE] >= 0.0
        over = over or (afloat and until >= 0.0 and state[g.UNTIL_SIDE] < 0.0)
        if over and index + 1 == end and table[end, g.KIND] == g.END_HOLDING:
            state[g.DONE] = 1.0  # the last segment continues without limits
            state[g.ARRIVED] = 0.0
        elif over:
            _enter(table, state, index + 1, t, depth, altitude, heading)
            return
    state[g.PHASE] = following
