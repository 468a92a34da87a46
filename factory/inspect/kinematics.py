"""Kinematics: whether position, velocity, attitude, rates and current of a mission agree."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.frames import euler_to_matrix

Array = NDArray[np.float64]

STEP_TOLERANCE_M = 0.3
"""[m] position change of one sample against its velocities; a launch from rest makes 0.08"""
DRIFT_TOLERANCE_M = 1.0
"""[m] the same, summed over a mission"""
VELOCITY_TOLERANCE = 1e-4
"""[m/s] over ground = through the water + current; rounding makes 2e-6"""
TURN_TOLERANCE = 0.2
"""[rad] attitude changes against the rates, summed over a mission; inflections make 0.03"""


def kinematic_problems(truth: Mapping[str, Array], period: float) -> list[str]:
    """What does not fit together among position, velocity, attitude, rates and current.

    Args:
      truth: true_* signals of shape (time,), degrees as stored.
      period: [s] between samples.
    """
    position = _columns(truth, "true_", "north", "east", "depth")
    velocity = _columns(truth, "true_velocity_", "north", "east", "down")
    through = _columns(truth, "true_", "surge", "sway", "heave")
    current = _columns(truth, "true_current_", "north", "east", "down")
    rates = _columns(truth, "true_", "roll_rate", "pitch_rate", "yaw_rate")
    angles = np.radians(_columns(truth, "true_", "roll", "pitch", "heading"))
    if not all(np.isfinite(a).all() for a in (position, velocity, through, current, rates, angles)):
        return []  # the check of finite values names them
    to_ned = euler_to_matrix(*angles.T)
    moved = np.diff(position, axis=0) - period * (velocity[1:] + velocity[:-1]) / 2
    turn = np.einsum("tji,tjk->tik", to_ned[:-1], to_ned[1:])
    # half the antisymmetric part of a rotation is its axis times the sine of its angle
    angle = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0],
         turn[:, 1, 0] - turn[:, 0, 1]], axis=-1
    )  # fmt: skip
    sine = np.linalg.norm(angle, axis=-1)
    turned = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))
    angle *= np.divide(turned, sine, out=np.ones_like(sine), where=sine > 0.0)[:, None]
    figures = (
        (
            "velocity over ground is not velocity through the water plus current",
            np.abs(np.einsum("tij,tj->ti", to_ned, through) + current - velocity),
            VELOCITY_TOLERANCE,
            "m/s",
        ),
        ("position does not follow velocity", np.abs(moved), STEP_TOLERANCE_M, "m"),
        (
            "position drifts from the summed velocity",
            np.abs(np.cumsum(moved, axis=0)),
            DRIFT_TOLERANCE_M,
            "m",
        ),
        (
            "attitude does not follow the rates",
            np.abs(np.cumsum(angle - period * (rates[1:] + rates[:-1]) / 2, axis=0)),
            TURN_TOLERANCE,
            "rad",
        ),
    )
    return [
        f"{what}: {error.max():.3g} {unit} at sample {int(np.argmax(error.max(axis=-1)))}, "
        f"at most {tolerance:g}"
        for what, error, tolerance, unit in figures
        if error.size and error.max() > tolerance
    ]


def _columns(signals: Mapping[str, Array], prefix: str, *names: str) -> Array:
    return np.stack([signals[prefix + name] for name in names], axis=-1)
