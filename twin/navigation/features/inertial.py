"""Gyroscope and accelerometer: their readings, and what gravity says of the pitch.

A glider hardly accelerates, so its accelerometer is an inclinometer without the errors that the
gyros add to an attitude filter; the bias of the accelerometer is in both.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from twin.navigation.features.base import SLOW_S, Feature, Term
from twin.navigation.features.glide import C_DAMPED, damped_quotient

FORCES = (
    "measured_specific_force_x",
    "measured_specific_force_y",
    "measured_specific_force_z",
)


def gravity_sine(x: Any, y: Any, z: Any) -> Any:
    """Sine of the pitch, nose up, from the direction of the specific force; 0 in free fall."""
    size = np.sqrt(x**2 + y**2 + z**2)
    return np.divide(x, size, out=np.zeros_like(size), where=size > 0.0)


def gravity_glide_speed(depth_rate: Any, x: Any, y: Any, z: Any) -> Any:
    """`glide_speed` with the pitch from gravity [m/s]."""
    return damped_quotient(depth_rate, gravity_sine(x, y, z))


C_GRAVITY_SINE = """
const double size = sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]);
return size > 0.0 ? t[0] / size : 0.0;
"""
"""`gravity_sine` in C99."""
C_GRAVITY_GLIDE = f"""
const double size = sqrt(t[1] * t[1] + t[2] * t[2] + t[3] * t[3]);
const double rate = t[0], sine = size > 0.0 ? t[1] / size : 0.0;
{C_DAMPED}
"""
"""`gravity_glide_speed` in C99."""


def _plain(name: str, group: str, channel: str, unit: str, *, odd: bool = False) -> Feature:
    return Feature(name=name, group=group, unit=unit, terms=(Term(channel=channel),), odd=odd)


def _mean_force(seconds: float) -> tuple[Term, ...]:
    return tuple(Term(channel=name, look="mean", seconds=seconds) for name in FORCES)


def _gravity_glide(name: str, seconds: float) -> Feature:
    rate = Term(channel="measured_depth", look="slope", seconds=seconds)
    return Feature(
        name=name,
        group="gravity",
        unit="m s-1",
        terms=(rate, *_mean_force(seconds)),
        combine=gravity_glide_speed,
        c=C_GRAVITY_GLIDE,
    )


ROLL_RATE = _plain("roll_rate", "gyroscope", "measured_roll_rate", "rad s-1", odd=True)
PITCH_RATE = _plain("pitch_rate", "gyroscope", "measured_pitch_rate", "rad s-1")
YAW_RATE = _plain("yaw_rate", "gyroscope", "measured_yaw_rate", "rad s-1", odd=True)
SPECIFIC_FORCE_X = _plain("specific_force_x", "accelerometer", FORCES[0], "m s-2")
SPECIFIC_FORCE_Y = _plain("specific_force_y", "accelerometer", FORCES[1], "m s-2", odd=True)
SPECIFIC_FORCE_Z = _plain("specific_force_z", "accelerometer", FORCES[2], "m s-2")
GRAVITY_PITCH_SINE = Feature(
    name="gravity_pitch_sine",
    group="gravity",
    unit="1",
    terms=_mean_force(SLOW_S),
    combine=gravity_sine,
    c=C_GRAVITY_SINE,
)
GRAVITY_GLIDE_SPEED = _gravity_glide("gravity_glide_speed", 0.0)
GRAVITY_GLIDE_SPEED_SLOW = _gravity_glide("gravity_glide_speed_slow", SLOW_S)
