"""Flown features: depth, its rate, the speed that explains it, and motion by the flight filter.

The filter (`twin.navigation.flight_filter`) balances forces with constants that it estimates under
way.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from twin.navigation.features.base import SLOW_S, Feature, Look, Term

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
