"""Frames: conversions between MuJoCo's axes and NED/FRD, and between kinds of attitude.

Public frames are NED (north, east, down) for the world and FRD (forward, starboard, down) for
the body. MuJoCo's world here is x north, y west, z up and its hull x forward, y port, z up, so
both conversions are the same involution diag(1, -1, -1); it maps vectors, axial vectors and
the vector part of quaternions alike because it is a proper rotation (180 deg about x).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twin.numbers import Array

FLIP = np.array([1.0, -1.0, -1.0])
UPRIGHT = 1e-6
"""Cosine of the pitch below which rounding would decide about roll and heading"""
FLIP_QUATERNION = np.array([1.0, 1.0, -1.0, -1.0])


def flip_vector(vector: ArrayLike) -> Array:
    """Convert NED to MuJoCo's world, FRD to hull axes, or back. Shape (..., 3), any unit."""
    return np.asarray(vector, float) * FLIP


def flip_quaternion(quaternion: ArrayLike) -> Array:
    """Body-to-world quaternion (w, x, y, z) between NED/FRD and MuJoCo. Shape (..., 4)."""
    return np.asarray(quaternion, float) * FLIP_QUATERNION


def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors, shape (3,); faster than `np.cross`, with identical bits."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def euler_to_quaternion(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> Array:
    """Convert ZYX Euler angles [rad] to the body-to-NED quaternion (w, x, y, z). Shape (..., 4).

    Fossen (2021), section 2.2.2.
    """
    half = [np.asarray(angle, float) / 2 for angle in (roll, pitch, heading)]
    (cr, cp, ch), (sr, sp, sh) = [np.cos(h) for h in half], [np.sin(h) for h in half]
    return np.stack(
        [
            cr * cp * ch + sr * sp * sh,
            sr * cp * ch - cr * sp * sh,
            cr * sp * ch + sr * cp * sh,
            cr * cp * sh - sr * sp * ch,
        ],
        axis=-1,
    )


def quaternion_to_euler(quaternion: ArrayLike) -> tuple[Array, Array, Array]:
    """Convert body-to-NED quaternions (..., 4) to roll, pitch and heading [0, 2 pi), all [rad].

    With the nose straight up or down roll and heading are one angle: it is given as the heading.
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    roll = np.arctan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    sine = np.clip(2 * (w * y - x * z), -1.0, 1.0)
    ahead, aside = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z)
    heading = np.arctan2(aside, ahead)
    upright = np.hypot(ahead, aside) < UPRIGHT
    if upright.any():
        roll = np.where(upright, 0.0, roll)
        heading = np.where(upright, 2.0 * np.arctan2(-np.sign(sine) * x, w), heading)
    return roll, np.arcsin(sine), np.mod(heading, 2 * np.pi)


def quaternion_to_matrix(quaternion: ArrayLike) -> Array:
    """Rotation matrix from body to NED of a quaternion (..., 4). Shape (..., 3, 3)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def euler_to_matrix(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> Array:
    """Rotation matrix from body to NED of ZYX Euler angles [rad]. Shape (..., 3, 3)."""
    return quaternion_to_matrix(euler_to_quaternion(roll, pitch, heading))
