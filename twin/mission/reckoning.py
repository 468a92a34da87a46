"""Reckoning: instrument readings of guidance, its PID loop, and dead reckoning of its position.

Guidance that runs on the true state reads depth, heading and altitude through these functions. Each
instrument fault is a number among the gains. All are zero in a sound vehicle, whose readings equal
the truth bit for bit.

Between fixes, guidance adds up its path through the water as gliders do, from vertical velocity,
pitch and heading with the steady angle of attack, or from the propeller's speed. At the first fix
after a dive, the misclosure divided by the time under water is the estimated current. The next dive
adds it to the path, and its course allows for it.
"""

from __future__ import annotations

import math

from twin.compiled import borrowing
from twin.mission import mission_file as g

ALTITUDE_S = 20.0
"""[s] Time for which the last altimeter return stays valid."""
OUT_OF_REACH = 1e4
"""[m] Altitude without an altimeter return: deeper than the vehicle can dive."""


@borrowing
def heading_read(gains, heading):
    """Compass reading [rad] for a true heading [rad], with offset and the vehicle's own iron."""
    seen = heading + gains[g.COMPASS_OFFSET]
    if gains[g.IRON_SINE] != 0.0 or gains[g.IRON_COSINE] != 0.0:
        seen += gains[g.IRON_SINE] * math.sin(heading) + gains[g.IRON_COSINE] * math.cos(heading)
    return seen


@borrowing
def altitude_read(gains, state, t, altitude):
    """Altitude [m] from the altimeter's returns at time `t` [s].

    A faulty altimeter loses a fraction of its returns, evenly over the ticks. The last return is
    valid for ALTITUDE_S; then the altitude is OUT_OF_REACH.

    Args:
      state: guidance's state; its three numbers of the altimeter are updated.
      altitude: true altitude, inf without a sea floor.
    """
    if state[g.PHASE] == g.NOT_STARTED:
        state[g.ECHO], state[g.ECHO_TIME] = OUT_OF_REACH, t
    lost = gains[g.ECHOES_LOST]
    if not lost > 0.0 or math.isinf(altitude):
        state[g.ECHO], state[g.ECHO_TIME] = altitude, t
        return altitude
    state[g.ECHOES_DUE] += 1.0 - lost
    if state[g.ECHOES_DUE] >= 1.0:
        state[g.ECHOES_DUE] -= 1.0
        state[g.ECHO], state[g.ECHO_TIME] = altitude, t
    elif t - state[g.ECHO_TIME] > ALTITUDE_S:
        state[g.ECHO] = OUT_OF_REACH
    return float(state[g.ECHO])


@borrowing
def pid(gains, first, error, rate, feedforward, low, high, zone, state, slot):
    """Run one PID tick with the derivative on the measured rate; return the clamped output.

    Its three gains begin at gains[first]. state[slot] keeps the integral of the error, with the
    error limited to `zone`. It is frozen while the output is clamped and the error pushes it out.
    """
    kp, ki, kd = gains[first], gains[first + 1], gains[first + 2]
    output = feedforward + kp * error + ki * state[slot] - kd * rate
    clamped = min(max(output, low), high)
    if (output - clamped) * error * ki <= 0.0:
        state[slot] += gains[g.PERIOD] * min(max(error, -zone), zone)
    return clamped


@borrowing
def wrapped(angle):
    """Wrap `angle` [rad] to [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@borrowing
def compass(angle):
    """Wrap `angle` [rad] to [0, 2 pi), as for headings."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi))


LEAST_SLOPE = math.radians(8.0)
"""[rad] Glide angle below which vertical velocity gives no speed; the steady speed is used."""
MOST_OF_STEADY = 2.0
"""[1] Limit of the reckoned speed as a multiple of the steady speed."""
MOST_SPEED = 1.0
"""[m/s] Limit of the reckoned speed if the steady speed is unknown."""
LEAST_DIVE = 300.0
"""[s] Smallest time under water for an estimate of the current; below, the fix error dominates."""
MOST_CRAB = math.sin(math.radians(70.0))
"""[1] Largest fraction of the speed against a cross current; the rest still goes to the target."""


@borrowing
def speed_through_water(row, phase, depth_rate, pitch):
    """Horizontal speed [m/s] from vertical velocity [m/s] and pitch [rad], or the propeller's."""
    if phase == g.AT_SURFACE or phase == g.HOVERING or phase == g.POSING:
        return 0.0
    if phase == g.DIVE or phase == g.ON_LEVEL:
        steady, attack = row[g.DIVE_SPEED], row[g.DIVE_ATTACK]
    elif phase == g.CLIMB or phase == g.SURFACING:
        steady, attack = row[g.CLIMB_SPEED], row[g.CLIMB_ATTACK]
    else:
        steady, attack = math.nan, 0.0
    unknown = math.isnan(steady)
    if math.isnan(attack):
        return 0.0 if unknown else steady
    slope = attack - pitch
    if abs(slope) < LEAST_SLOPE:
        return 0.0 if unknown else steady
    most = MOST_SPEED if unknown else MOST_OF_STEADY * steady
    return min(max(depth_rate / math.tan(slope), 0.0), most)


@borrowing
def _fix(state, t, north, east):
    """Process a fix; the first fix after a dive gives the current estimate."""
    elapsed = t - state[g.LAST_FIX]
    if state[g.FIXED] == 0.0 and elapsed >= LEAST_DIVE:
        missed_north = north - state[g.RECKONED_NORTH] + state[g.DRIFT_NORTH]
        missed_east = east - state[g.RECKONED_EAST] + state[g.DRIFT_EAST]
        state[g.CURRENT_NORTH] = missed_north / elapsed
        state[g.CURRENT_EAST] = missed_east / elapsed
        state[g.CURRENT_KNOWN] = 1.0
    state[g.RECKONED_NORTH], state[g.RECKONED_EAST] = north, east
    state[g.DRIFT_NORTH] = state[g.DRIFT_EAST] = 0.0
    state[g.LAST_FIX], state[g.FIXED] = t, 1.0


@borrowing
def reckon(row, state, t, depth, pitch, heading, north, east, current_north, current_east):
    """Update the reckoned position to time `t`; see `guidance_step` for the arguments.

    `row` and the phase in `state` are those since the last tick.
    """
    known = not math.isnan(north + east)
    phase = state[g.PHASE]
    if phase == g.NOT_STARTED:
        state[g.LAST_FIX], state[g.LAST_TIME], state[g.LAST_DEPTH] = t, t, depth
        if known:
            state[g.RECKONED_NORTH], state[g.RECKONED_EAST] = north, east
    elapsed = t - state[g.LAST_TIME]
    state[g.LAST_TIME] = t
    if elapsed > 0.0:
        rate = (depth - state[g.LAST_DEPTH]) / elapsed
        speed = speed_through_water(row, phase, rate, pitch)
        drift_north = drift_east = 0.0
        if row[g.USES_CURRENT] != 0.0:
            drift_north = state[g.CURRENT_NORTH] * elapsed
            drift_east = state[g.CURRENT_EAST] * elapsed
        state[g.RECKONED_NORTH] += speed * math.cos(heading) * elapsed + drift_north
        state[g.RECKONED_EAST] += speed * math.sin(heading) * elapsed + drift_east
        state[g.DRIFT_NORTH] += drift_north
        state[g.DRIFT_EAST] += drift_east
    if known and not math.isnan(current_north + current_east):  # a navigator is on board
        state[g.CURRENT_NORTH], state[g.CURRENT_EAST] = current_north, current_east
        state[g.RECKONED_NORTH], state[g.RECKONED_EAST] = north, east
        state[g.CURRENT_KNOWN] = 1.0
        if phase == g.AT_SURFACE:
            state[g.LAST_FIX] = t
    elif phase == g.AT_SURFACE and known:
        _fix(state, t, north, east)
    elif phase == g.AT_SURFACE:
        state[g.LAST_FIX] = t
    else:
        state[g.FIXED] = 0.0
    state[g.SEEN_NORTH], state[g.SEEN_EAST] = state[g.RECKONED_NORTH], state[g.RECKONED_EAST]
    if row[g.SEES_TRUTH] == 1.0 and known:
        state[g.SEEN_NORTH], state[g.SEEN_EAST] = north, east


@borrowing
def distance_left(row, state):
    """Distance [m] from the estimated position to the row's target."""
    return math.hypot(
        row[g.TARGET_NORTH] - state[g.SEEN_NORTH], row[g.TARGET_EAST] - state[g.SEEN_EAST]
    )


@borrowing
def course(row, state):
    """Heading [rad] whose track leads to the row's target in the estimated current.

    The heading cancels the cross-track current; MOST_CRAB limits the correction.
    """
    bearing = math.atan2(
        row[g.TARGET_EAST] - state[g.SEEN_EAST], row[g.TARGET_NORTH] - state[g.SEEN_NORTH]
    )
    if row[g.USES_CURRENT] == 0.0 or not row[g.YO_SPEED] > 0.0:
        return compass(bearing)
    across = state[g.CURRENT_EAST] * math.cos(bearing) - state[g.CURRENT_NORTH] * math.sin(bearing)
    share = min(max(across / row[g.YO_SPEED], -MOST_CRAB), MOST_CRAB)
    return compass(bearing - math.asin(share))
