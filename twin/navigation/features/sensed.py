"""Shipped features: depth, attitude, inertial sensors and controls as networks see them.

A glider hardly accelerates, so its accelerometer is an inclinometer without the errors that the
gyros add to an attitude filter; the bias of the accelerometer is in both. The motion by the flight
filter (`twin.navigation.flight_filter`) balances forces with constants estimated under way.

Attitude has sines and cosines, their means, and how fast it turns. Controls are the positions of a
glider's parts, how fast they move, and their commands.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from twin.navigation.features.base import SLOW_S, Feature, Look, Shape, Term


def _one(
    name: str, group: str, channel: str, unit: str = "1", shape: Shape = "plain",
    look: Look = "last", seconds: float = 0.0, *, odd: bool = False,
) -> Feature:  # fmt: skip
    term = Term(channel=channel, shape=shape, look=look, seconds=seconds)
    return Feature(name=name, group=group, unit=unit, terms=(term,), odd=odd)


FLAT_SINE = 0.15
"""Sine of the pitch (9 degrees) below which `glide_speed` fades to zero instead of growing."""


def damped_quotient(depth_rate: Any, sine: Any) -> Any:
    """-z' / s without the pole at an inflection: the regularised -z' s / (s^2 + FLAT_SINE^2)."""
    return -depth_rate * sine / (sine**2 + FLAT_SINE**2)


def glide_speed(depth_rate: Any, pitch: Any) -> Any:
    """Speed [m/s] along the body that explains the depth rate [m/s] at this pitch [deg]."""
    return damped_quotient(depth_rate, np.sin(np.deg2rad(pitch)))


C_DAMPED = f"return -rate * sine / (sine * sine + {FLAT_SINE**2!r}f);"
"""`damped_quotient` in C99."""
C_GLIDE = f"""
const float rate = t[0], sine = gt_sine(t[1] * {math.radians(1.0):.9g}f);
{C_DAMPED}
"""
"""`glide_speed` in C99."""


def _glide(name: str, look: Look, seconds: float) -> Feature:
    rate = Term(channel="measured_depth", look="slope", seconds=seconds)
    pitch = Term(channel="measured_pitch", look=look, seconds=seconds)
    return Feature(
        name=name, group=name, unit="m s-1", terms=(rate, pitch), combine=glide_speed, c=C_GLIDE
    )


DEPTH = _one("depth", "depth", "measured_depth", "m")
DEPTH_RATE = _one("depth_rate", "depth_rate", "measured_depth", "m s-1", look="slope")
DEPTH_RATE_SLOW = _one(
    "depth_rate_slow", "depth_rate_slow", "measured_depth", "m s-1", look="slope", seconds=SLOW_S
)
GLIDE_SPEED = _glide("glide_speed", "last", 0.0)
GLIDE_SPEED_SLOW = _glide("glide_speed_slow", "mean", SLOW_S)


FORCES = tuple(f"measured_specific_force_{axis}" for axis in "xyz")


def gravity_sine(x: Any, y: Any, z: Any) -> Any:
    """Sine of the pitch, nose up, from the direction of the specific force; 0 in free fall."""
    size = np.sqrt(x**2 + y**2 + z**2)
    return np.divide(x, size, out=np.zeros_like(size), where=size > 0.0)


def gravity_glide_speed(depth_rate: Any, x: Any, y: Any, z: Any) -> Any:
    """`glide_speed` with the pitch from gravity [m/s]."""
    return damped_quotient(depth_rate, gravity_sine(x, y, z))


C_GRAVITY_SINE = """
const float size = sqrtf(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]);
return size > 0.0f ? t[0] / size : 0.0f;
"""
"""`gravity_sine` in C99."""
C_GRAVITY_GLIDE = f"""
const float size = sqrtf(t[1] * t[1] + t[2] * t[2] + t[3] * t[3]);
const float rate = t[0], sine = size > 0.0f ? t[1] / size : 0.0f;
{C_DAMPED}
"""
"""`gravity_glide_speed` in C99."""


def _mean_force(seconds: float) -> tuple[Term, ...]:
    return tuple(Term(channel=name, look="mean", seconds=seconds) for name in FORCES)


def _gravity_glide(name: str, seconds: float) -> Feature:
    rate = Term(channel="measured_depth", look="slope", seconds=seconds)
    return Feature(
        name=name, group="gravity", unit="m s-1", terms=(rate, *_mean_force(seconds)),
        combine=gravity_glide_speed, c=C_GRAVITY_GLIDE,
    )  # fmt: skip


ROLL_RATE = _one("roll_rate", "gyroscope", "measured_roll_rate", "rad s-1", odd=True)
PITCH_RATE = _one("pitch_rate", "gyroscope", "measured_pitch_rate", "rad s-1")
YAW_RATE = _one("yaw_rate", "gyroscope", "measured_yaw_rate", "rad s-1", odd=True)
SPECIFIC_FORCE_X = _one("specific_force_x", "accelerometer", FORCES[0], "m s-2")
SPECIFIC_FORCE_Y = _one("specific_force_y", "accelerometer", FORCES[1], "m s-2", odd=True)
SPECIFIC_FORCE_Z = _one("specific_force_z", "accelerometer", FORCES[2], "m s-2")
GRAVITY_PITCH_SINE = Feature(
    name="gravity_pitch_sine", group="gravity", unit="1", terms=_mean_force(SLOW_S),
    combine=gravity_sine, c=C_GRAVITY_SINE,
)  # fmt: skip
GRAVITY_GLIDE_SPEED = _gravity_glide("gravity_glide_speed", 0.0)
GRAVITY_GLIDE_SPEED_SLOW = _gravity_glide("gravity_glide_speed_slow", SLOW_S)


def _change(name: str, angle: str, *, slow: bool = False, odd: bool = False) -> Feature:
    seconds = SLOW_S if slow else 0.0
    group = "attitude_rate_slow" if slow else "attitude_rate"
    return _one(name, group, f"measured_{angle}", "rad s-1", "angle", "slope", seconds, odd=odd)


SIN_ROLL = _one("sin_roll", "attitude", "measured_roll", shape="sine", odd=True)
COS_ROLL = _one("cos_roll", "attitude", "measured_roll", shape="cosine")
SIN_PITCH = _one("sin_pitch", "attitude", "measured_pitch", shape="sine")
COS_PITCH = _one("cos_pitch", "attitude", "measured_pitch", shape="cosine")
SIN_ROLL_SLOW = _one(
    "sin_roll_slow", "attitude_slow", "measured_roll", "1", "sine", "mean", SLOW_S, odd=True
)
SIN_PITCH_SLOW = _one(
    "sin_pitch_slow", "attitude_slow", "measured_pitch", "1", "sine", "mean", SLOW_S
)
ROLL_CHANGE = _change("roll_change", "roll", odd=True)
PITCH_CHANGE = _change("pitch_change", "pitch")
HEADING_CHANGE = _change("heading_change", "heading", odd=True)
ROLL_CHANGE_SLOW = _change("roll_change_slow", "roll", slow=True, odd=True)
PITCH_CHANGE_SLOW = _change("pitch_change_slow", "pitch", slow=True)
HEADING_CHANGE_SLOW = _change("heading_change_slow", "heading", slow=True, odd=True)


SHIFT = _one("shift", "controls", "measured_shift", "m")
SIN_ROTATION = _one("sin_rotation", "controls", "measured_rotation", "1", "sine", odd=True)
COS_ROTATION = _one("cos_rotation", "controls", "measured_rotation", "1", "cosine")
PUMP = _one("pump", "controls", "measured_pump", "cm3")
SHIFT_CHANGE = _one("shift_change", "control_rate", "measured_shift", "m s-1", look="slope")
ROTATION_CHANGE = _one(
    "rotation_change", "control_rate", "measured_rotation", "rad s-1", "angle", "slope", odd=True
)
PUMP_CHANGE = _one("pump_change", "control_rate", "measured_pump", "cm3 s-1", look="slope")
SHIFT_COMMAND = _one("shift_command", "commands", "commanded_shift", "m")
SIN_ROTATION_COMMAND = _one(
    "sin_rotation_command", "commands", "commanded_rotation", "1", "sine", odd=True
)
COS_ROTATION_COMMAND = _one("cos_rotation_command", "commands", "commanded_rotation", "1", "cosine")
PUMP_COMMAND = _one("pump_command", "commands", "commanded_pump", "cm3")

FLIGHT_SURGE = _one("flight_surge", "flight", "estimated_surge", "m s-1")
FLIGHT_SWAY = _one("flight_sway", "flight", "estimated_sway", "m s-1", odd=True)
FLIGHT_ATTACK = _one("flight_attack", "flight", "estimated_attack", "rad")
