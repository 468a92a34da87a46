"""Axes: from the store's frames to those of ROS.

Stores count north, east, down and forward, starboard, down; ROS counts east, north, up in the
world and forward, left, up on a vehicle (REP 103). Yaw is zero to the east and counts to the
north; a nose that points up has a negative pitch there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.frames import euler_to_quaternion

Array = NDArray[np.float64]


def world(north: Array, east: Array, down: Array) -> Array:
    """East, north, up, (samples, 3), of a vector in the world, any unit."""
    return np.stack([east, north, -down], axis=1)


def body(forward: Array, starboard: Array, down: Array) -> Array:
    """Forward, left, up, (samples, 3), of a vector or of rates about the axes, any unit."""
    return np.stack([forward, -starboard, -down], axis=1)


def orientation(roll: Array, pitch: Array, heading: Array) -> Array:
    """Quaternion (x, y, z, w), (samples, 4), from forward, left, up to east, north, up.

    Args:
      roll, pitch: [degree] starboard down and nose up.
      heading: [degree] from true north, clockwise.
    """
    angles = (np.radians(roll), -np.radians(pitch), np.radians(90.0 - heading))
    w, x, y, z = euler_to_quaternion(*angles).T
    return np.stack([x, y, z, w], axis=1)


def to_body(quaternion: Array, vector: Array) -> Array:
    """A vector of the world in the axes of the vehicle, (samples, 3).

    Args:
      quaternion: as `orientation` gives it.
      vector: east, north, up.
    """
    axis, w = -quaternion[:, :3], quaternion[:, 3:]
    across = 2.0 * np.cross(axis, vector)
    return vector + w * across + np.cross(axis, across)
