"""Checks of a current's settings, worded alike for all types, and parsing of `NAME=VALUE` texts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import Any

from twin.errors import CurrentError

FASTEST_CURRENT = 10.0
"""[m/s] Largest plausible current (tidal races reach about 8); above it the units are wrong."""


def finite(kind: str, name: str, value: float, unit: str) -> float:
    """Return `value` as a float; raises CurrentError unless it is a finite number."""
    try:
        number = float(value)
    except OverflowError:  # an integer with hundreds of digits
        number = math.inf
    except (TypeError, ValueError):
        raise CurrentError(f"{kind}: {name} must be a number in {unit}, not {value!r}") from None
    if not math.isfinite(number):
        raise CurrentError(f"{kind}: {name} must be a finite number in {unit}, not {number}")
    return number


def speed(kind: str, name: str, value: float, unit: str = "m/s") -> float:
    """Return `value` as a plausible velocity component [m/s], or raise CurrentError."""
    number = finite(kind, name, value, unit)
    if abs(number) > FASTEST_CURRENT:
        raise CurrentError(
            f"{kind}: {name} is {number} m/s, beyond {FASTEST_CURRENT:g} m/s: give it in m/s"
        )
    return number


def positive(kind: str, name: str, value: float, unit: str) -> float:
    """Return `value` as a float greater than zero; raises CurrentError."""
    number = finite(kind, name, value, unit)
    if number <= 0.0:
        raise CurrentError(f"{kind}: {name} must be greater than 0 {unit}, not {number:g}")
    return number


def not_negative(kind: str, name: str, value: float, unit: str) -> float:
    """Return `value` as a float of at least zero; raises CurrentError."""
    number = finite(kind, name, value, unit)
    if number < 0.0:
        raise CurrentError(f"{kind}: {name} must be at least 0 {unit}, not {number:g}")
    return number


def setting(
    *names: str,
    unit: str = "",
    check: Callable[..., float] | None = finite,
    default: Any = dataclasses.MISSING,
) -> Any:
    """Make a dataclass field with its command-line names and one of the checks above.

    A value None is not checked. `check` None marks a field that holds text.
    """
    metadata = {"names": names, "unit": unit, "check": check}
    return dataclasses.field(default=default, metadata=metadata)


def split_settings(kind: str, rest: str) -> tuple[list[str], dict[str, str]]:
    """Split comma-separated values into positional ones and NAME=VALUE."""
    positional: list[str] = []
    given: dict[str, str] = {}
    for item in rest.split(","):
        name, equals, value = item.partition("=")
        name, value = name.strip(), value.strip()
        if not equals:
            positional.append(name)
            continue
        name = name.lower()
        if name in given:
            raise CurrentError(f"{kind}: {name}= is given twice")
        given[name] = value
    return positional, given


def number(kind: str, name: str, text: str) -> float:
    """Parse a finite number; raises CurrentError."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CurrentError(f"{kind}: {name} must be a number, not {text!r}")
    return value


def whole_number(kind: str, name: str, text: str) -> int:
    """Parse a whole number; raises CurrentError."""
    value = number(kind, name, text)
    if value != int(value):
        raise CurrentError(f"{kind}: {name} must be a whole number, not {value:g}")
    return int(value)


def allowed(names: Iterable[str]) -> str:
    """End of an error message: the list of allowed settings."""
    return f"settings: {', '.join(names)}"
