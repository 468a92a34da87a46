"""Instruments: what guidance reads of depth, heading and altitude where an instrument is faulty.

Guidance that is flown by the true state reads it through here. Each fault is a number among the
gains, all zeros in a sound vehicle, which then reads the truth to the last bit.
"""

from __future__ import annotations

import math

from twin.compiled import borrowing
from twin.mission import mission_file as g
from twin.numbers import Array

ALTITUDE_S = 20.0
"""[s] for which the last echo of the altimeter holds"""
OUT_OF_REACH = 1e4
"""[m] of water below a vehicle whose altimeter has no echo: deeper than it can dive"""


@borrowing
def heading_read(gains: Array, heading: float) -> float:
    """Compass reading [rad] of a true heading [rad]: its offset, and the iron of the vehicle."""
    seen = heading + gains[g.COMPASS_OFFSET]
    if gains[g.IRON_SINE] != 0.0 or gains[g.IRON_COSINE] != 0.0:
        seen += gains[g.IRON_SINE] * math.sin(heading) + gains[g.IRON_COSINE] * math.cos(heading)
    return seen


@borrowing
def altitude_read(gains: Array, state: Array, t: float, altitude: float) -> float:
    """Altitude [m] by the echoes that come back at time `t` [s].

    A faulty altimeter loses its share of them, evenly over the ticks. The last one holds for
    ALTITUDE_S, then the floor is out of reach.

    Args:
      state: of guidance; its three numbers of the altimeter are updated.
      altitude: true one, inf without a sea floor.
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
