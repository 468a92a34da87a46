"""Features: what networks see of depth, attitude, inertial sensors and controls.

A glider hardly accelerates, so its accelerometer is an inclinometer without the errors that the
gyros add to an attitude filter; the bias of the accelerometer is in both. The motion by the flight
filter (`twin.navigation.flight_filter`) balances forces with constants estimated under way.

Attitude has sines and cosines, their means, and how fast it turns. Controls are the positions of a
glider's parts, how fast they move, and their commands.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from twin.navigation.features.base import SLOW_S, Feature, Look, Shape, Term

FLIGHT_SURGE = Feature(
    name="flight_surge", group="flight", unit="m s-1", terms=(Term(channel="estimated_surge"),)
)
FLIGHT_SWAY = Feature(
    name="flight_sway",
    group="flight",
    unit="m s-1",
    terms=(Term(channel="estimated_sway"),),
    odd=True,
)
FLIGHT_ATTACK = Feature(
    name="flight_attack", group="flight", unit="rad", terms=(Term(channel="estimated_attack"),)
)


FLAT_SINE = 0.15
"""Sine of the pitch (9 degrees) below which `glide_speed` fades to zero instead of growing."""


def damped_quotient(depth_rate: Any, sine: Any) -> Any:
    """-z' / s without the pole at an inflection: the regularised -z' s / (s^2 + FLAT_SINE^2)."""
    return -depth_rate * sine / (sine**2 + FLAT_SINE**2)


def glide_speed(depth_rate: Any, pitch: Any) -> Any:
    """Speed [m/s] along the body that explains the depth rate [m/s] at this pitch [deg]."""
    return damped_quotient(depth_rate, np.sin(np.deg2rad(pitch)))


C_DAMPED = f"return -rate * sine / (sine * sine + {FLAT_SINE**2!r});"
"""`damped_quotient` in C99."""
C_GLIDE = f"""
const double rate = t[0], sine = sin(t[1] * 3.14159265358979323846 / 180.0);
{C_DAMPED}
"""
"""`glide_speed` in C99."""


def _rate(name: str, seconds: float) -> Feature:
    term = Term(channel="measured_depth", look="slope", seconds=seconds)
    return Feature(name=name, group=name, unit="m s-1", terms=(term,))


def _glide(name: str, look: Look, seconds: float) -> Feature:
    rate = Term(channel="measured_depth", look="slope", seconds=seconds)
    pitch = Term(channel="measured_pitch", look=look, seconds=seconds)
    return Feature(
        name=name, group=name, unit="m s-1", terms=(rate, pitch), combine=glide_speed, c=C_GLIDE
    )


DEPTH = Feature(name="depth", group="depth", unit="m", terms=(Term(channel="measured_depth"),))
DEPTH_RATE = _rate("depth_rate", 0.0)
DEPTH_RATE_SLOW = _rate("depth_rate_slow", SLOW_S)
GLIDE_SPEED = _glide("glide_speed", "last", 0.0)
GLIDE_SPEED_SLOW = _glide("glide_speed_slow", "mean", SLOW_S)


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


def _of(name: str, group: str, angle: str, shape: Shape, *, odd: bool = False) -> Feature:
    term = Term(channel=f"measured_{angle}", shape=shape)
    return Feature(name=name, group=group, unit="1", terms=(term,), odd=odd)


def _slow_sine(name: str, angle: str, *, odd: bool = False) -> Feature:
    term = Term(channel=f"measured_{angle}", shape="sine", look="mean", seconds=SLOW_S)
    return Feature(name=name, group="attitude_slow", unit="1", terms=(term,), odd=odd)


def _change(name: str, angle: str, *, slow: bool = False, odd: bool = False) -> Feature:
    seconds = SLOW_S if slow else 0.0
    term = Term(channel=f"measured_{angle}", shape="angle", look="slope", seconds=seconds)
    group = "attitude_rate_slow" if slow else "attitude_rate"
    return Feature(name=name, group=group, unit="rad s-1", terms=(term,), odd=odd)


SIN_ROLL = _of("sin_roll", "attitude", "roll", "sine", odd=True)
COS_ROLL = _of("cos_roll", "attitude", "roll", "cosine")
SIN_PITCH = _of("sin_pitch", "attitude", "pitch", "sine")
COS_PITCH = _of("cos_pitch", "attitude", "pitch", "cosine")
SIN_ROLL_SLOW = _slow_sine("sin_roll_slow", "roll", odd=True)
SIN_PITCH_SLOW = _slow_sine("sin_pitch_slow", "pitch")
ROLL_CHANGE = _change("roll_change", "roll", odd=True)
PITCH_CHANGE = _change("pitch_change", "pitch")
HEADING_CHANGE = _change("heading_change", "heading", odd=True)
ROLL_CHANGE_SLOW = _change("roll_change_slow", "roll", slow=True, odd=True)
PITCH_CHANGE_SLOW = _change("pitch_change_slow", "pitch", slow=True)
HEADING_CHANGE_SLOW = _change("heading_change_slow", "heading", slow=True, odd=True)


def _of_controls(
    name: str,
    group: str,
    channel: str,
    unit: str,
    shape: Shape = "plain",
    look: Look = "last",
    *,
    odd: bool = False,
) -> Feature:
    term = Term(channel=channel, shape=shape, look=look)
    return Feature(name=name, group=group, unit=unit, terms=(term,), odd=odd)


SHIFT = _of_controls("shift", "controls", "measured_shift", "m")
SIN_ROTATION = _of_controls("sin_rotation", "controls", "measured_rotation", "1", "sine", odd=True)
COS_ROTATION = _of_controls("cos_rotation", "controls", "measured_rotation", "1", "cosine")
PUMP = _of_controls("pump", "controls", "measured_pump", "cm3")
SHIFT_CHANGE = _of_controls("shift_change", "control_rate", "measured_shift", "m s-1", look="slope")
ROTATION_CHANGE = _of_controls(
    "rotation_change", "control_rate", "measured_rotation", "rad s-1", "angle", "slope", odd=True
)
PUMP_CHANGE = _of_controls("pump_change", "control_rate", "measured_pump", "cm3 s-1", look="slope")
SHIFT_COMMAND = _of_controls("shift_command", "commands", "commanded_shift", "m")
SIN_ROTATION_COMMAND = _of_controls(
    "sin_rotation_command", "commands", "commanded_rotation", "1", "sine", odd=True
)
COS_ROTATION_COMMAND = _of_controls(
    "cos_rotation_command", "commands", "commanded_rotation", "1", "cosine"
)
PUMP_COMMAND = _of_controls("pump_command", "commands", "commanded_pump", "cm3")
