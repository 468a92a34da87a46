"""Lane block: layout of the numbers of several vehicles (lanes) in one vector.

A block is one contiguous vector in which number `row` of lane `l` is at `row * lanes + l`, so that
one instruction works on several lanes.
"""

from __future__ import annotations

import numpy as np

LANES = (8, 64)
"""Lanes in a block, for few and for many vehicles. Both are multiples of any vector's width, and
their rows fit in the first-level cache. A lane's results are bit-identical in both sizes."""
STATE_WORDS = 14
"""Length of the state: north, east, depth [m]; quaternion body to NED, scalar first (4); v_r [m/s]
(3); rates [rad/s] (3), body FRD; the hull's temperature [degC]."""
POSE_WORDS = 7
"""Length of the pose in the state: position and quaternion."""
FLOW_WORDS = 15
"""Length of a `sample_gradient`: current [m/s] NED (3), local rate (3), gradient (9)."""
HEAD = {
    "state": STATE_WORDS,
    "rate": STATE_WORDS,  # of the state, per second; of the quaternion half a step later
    "before": STATE_WORDS - POSE_WORDS,  # rate of the state without its pose, one step before
    "going": 3,  # velocity over ground half a step later
    "looked": 4,  # north, east, depth [m] and time [s] of the last look-up of the water
    "flow": FLOW_WORDS,  # current and derivatives at the look-up, linear about it
    "density": 1,  # [kg/m3] at the look-up
    "density_slope": 1,  # [kg/m4]
    "temperature": 1,  # [degC] of the water at the look-up
    "temperature_slope": 1,  # [K/m]
    "immersion": 1,  # immersed fraction of the hull
    "lever": 1,  # [m] lever of the buoyancy, see `terms.immersed`
    "current": 3,  # NED [m/s] at the vehicle
    "path_rate": 3,  # dV_c/dt along the path, NED [m/s2]
    "water": 1,  # density [kg/m3] at the vehicle
    "net_mass": 1,  # [kg] fully immersed
    "euler": 3,  # roll, pitch, heading [rad]
    "length": 1,
    "diameter": 1,  # [m] of the hull
    "alive": 1,  # 1: flies, 0: has ended and stands still
    "wrong": 1,  # 1: left the range of physics in the last step
    "time": 1,  # [s] since the lane's start
}
PART = ("now", "command", "low", "high", "lag", "rate", "one_way")
"""Rows of each part: position by its encoder, command, travel, lag [s], largest rate, and whether
the position never rises again."""


def _places() -> dict[str, int]:
    found, at = {}, 0
    for name, words in HEAD.items():
        found[name], at = at, at + words
    return found


AT = _places()
"""First row of each group of HEAD."""
PARTS_AT = sum(HEAD.values())
"""First row of the parts: row `PARTS_AT + PART.index(name) * parts + k` belongs to part `k`."""


def row(index: int) -> str:
    """Text of a row of the block, for the current lane."""
    return f"b[{{{index}}} + l]"


def rows(name: str, count: int | None = None) -> str:
    """Text of a group of HEAD, as a tuple."""
    first = AT[name]
    return "(" + "".join(f"{row(first + k)}, " for k in range(count or HEAD[name])) + ")"


def empty_block(size: int) -> np.ndarray:
    """Make a block of `size` zeros, aligned to a cache line."""
    raw = np.zeros(size + 8)
    first = (-raw.ctypes.data % 64) // 8
    return raw[first : first + size]
