"""Checks of a current's settings, worded the same for every kind."""

from __future__ import annotations

import math

from twin.errors import CurrentError

FASTEST_CURRENT = 10.0
"""[m/s] No ocean current is faster (tidal races reach about 8); above it the units are wrong."""


def finite(kind: str, name: str, value: float, unit: str) -> float:
    """`value` as a float; raises CurrentError unless it is a finite number."""
    try:
        number = float(value)
    except OverflowError:  # a whole number with hundreds of digits
        number = math.inf
    except (TypeError, ValueError):
        raise CurrentError(f"{kind}: {name} must be a number in {unit}, not {value!r}") from None
    if not math.isfinite(number):
        raise CurrentError(f"{kind}: {name} must be a finite number in {unit}, not {number}")
    return number


def speed(kind: str, name: str, value: float) -> float:
    """`value` as a plausible velocity component [m/s] of either sign."""
    number = finite(kind, name, value, "m/s")
    if abs(number) > FASTEST_CURRENT:
        raise CurrentError(
            f"{kind}: {name} is {number} m/s, beyond {FASTEST_CURRENT:g} m/s: give it in m/s"
        )
    return number


def positive(kind: str, name: str, value: float, unit: str) -> float:
    """`value` as a float greater than zero."""
    number = finite(kind, name, value, unit)
    if number <= 0.0:
        raise CurrentError(f"{kind}: {name} must be greater than 0 {unit}, not {number:g}")
    return number


def not_negative(kind: str, name: str, value: float, unit: str) -> float:
    """`value` as a float of at least zero."""
    number = finite(kind, name, value, unit)
    if number < 0.0:
        raise CurrentError(f"{kind}: {name} must be at least 0 {unit}, not {number:g}")
    return number
