"""Block of lanes: which number of which vehicle stands where.

A block is one contiguous vector in which number `row` of lane `l` stands at `row * lanes + l`, so
that one instruction works on several lanes.
"""

from __future__ import annotations

import numpy as np

LANES = (8, 64)
"""Vehicles in a block, of few and of many: a multiple of every vector's width, and the rows stay in
the nearest cache. What a lane does is the same in both, to the last bit"""
STATE_WORDS = 14
"""north, east, depth [m]; quaternion body to NED, scalar first (4); v_r [m/s] (3); rates [rad/s]
(3), body FRD; the hull's temperature [degC]"""
POSE_WORDS = 7
"""of them, position and quaternion"""
FLOW_WORDS = 15
"""of `sample_gradient`: the current [m/s] NED (3), its local rate (3), its gradient (9)"""
HEAD = {
    "state": STATE_WORDS,
    "rate": STATE_WORDS,  # of the state, per second; the quaternion's is that half a step later
    "before": STATE_WORDS - POSE_WORDS,  # rate one step before, of what is no pose
    "going": 3,  # velocity over ground half a step later
    "looked": 4,  # north, east, depth [m] and time [s] at which the water was looked up
    "flow": FLOW_WORDS,  # there; the current is linear about it
    "density": 1,  # [kg/m3] there
    "density_slope": 1,  # [kg/m4]
    "temperature": 1,  # [degC] of the water there
    "temperature_slope": 1,  # [K/m]
    "immersion": 1,  # immersed part of the hull
    "lever": 1,  # [m] of the buoyancy, see `terms.immersed`
    "current": 3,  # NED [m/s] at the vehicle
    "path_rate": 3,  # dV_c/dt along the path, NED [m/s2]
    "water": 1,  # density [kg/m3] at the vehicle
    "net_mass": 1,  # [kg] fully immersed
    "euler": 3,  # roll, pitch, heading [rad]
    "length": 1,
    "diameter": 1,  # [m] of the hull
    "alive": 1,  # 1: flies, 0: has ended and stands still
    "wrong": 1,  # 1: has left physics in the last step
    "time": 1,  # [s] since the lane's start
}
PART = ("now", "command", "low", "high", "lag", "rate", "one_way")
"""Rows of each part: position by its encoder, command, travel, lag [s], largest rate, and whether
it never rises again"""


def _places() -> dict[str, int]:
    found, at = {}, 0
    for name, words in HEAD.items():
        found[name], at = at, at + words
    return found


AT = _places()
"""First row of each group of HEAD"""
PARTS_AT = sum(HEAD.values())
"""First row of the parts: row `PARTS_AT + PART.index(name) * parts + k` is of part `k`"""


def row(index: int) -> str:
    """A row of the block in the text, of the lane at hand."""
    return f"b[{{{index}}} + l]"


def rows(name: str, count: int | None = None) -> str:
    """A group of HEAD as a tuple."""
    first = AT[name]
    return "(" + "".join(f"{row(first + k)}, " for k in range(count or HEAD[name])) + ")"


def empty_block(size: int) -> np.ndarray:
    """A block of `size` zeros that begins on a line of the cache."""
    raw = np.zeros(size + 8)
    first = (-raw.ctypes.data % 64) // 8
    return raw[first : first + size]
