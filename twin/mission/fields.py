"""Checks of single mission fields; each raises a one-line MissionError that says what to give."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NoReturn

from twin.errors import MissionError, unknown_name
from twin.numbers import number as as_number

MAX_PITCH_DEG = 60.0
"""[deg] pitch below this: heading and roll lose their meaning as the hull stands up."""


def fail(label: str, field: str, value: object, rule: str) -> NoReturn:
    """Raise the MissionError that every field check raises."""
    raise MissionError(f"{label}: {field} = {value!r} is not possible: give {rule}")


def number(label: str, field: str, value: object) -> float:
    """`value` as a finite float; True and "3" are not numbers here."""
    try:
        result = as_number(value, field, MissionError)
    except MissionError:
        fail(label, field, value, "a number")
    if not math.isfinite(result):
        fail(label, field, value, "a finite number")
    return result


def within(
    label: str,
    field: str,
    value: object,
    unit: str,
    low: float,
    high: float = math.inf,
    *,
    open_low: bool = False,
    open_high: bool = False,
) -> None:
    """Check low <= value <= high, with either end left out where it is open."""
    x = number(label, field, value)
    if (x > low or (x == low and not open_low)) and (x < high or (x == high and not open_high)):
        return
    lower = f"above {low:g}" if open_low else f"at least {low:g}"
    if math.isinf(high):
        rule = lower
    elif open_low or open_high:
        rule = f"{lower} and {'below' if open_high else 'at most'} {high:g}"
    else:
        rule = f"{low:g} to {high:g}"
    fail(label, field, value, f"{rule} {unit}".rstrip())


def pitch(label: str, field: str, value: object) -> None:
    """A pitch magnitude [deg]."""
    within(label, field, value, "deg", 0.0, MAX_PITCH_DEG, open_low=True, open_high=True)


def heading(label: str, field: str, value: object) -> None:
    """A true heading [deg], written either way round."""
    within(label, field, value, "deg", -360.0, 360.0)


def rotation(label: str, field: str, value: object) -> None:
    """A battery rotation [deg]; the vehicle may allow less."""
    within(label, field, value, "deg", -180.0, 180.0)


def net_mass(label: str, field: str, value: object) -> None:
    """A magnitude of net buoyancy mass [kg]; the vehicle bounds it from above."""
    within(label, field, value, "kg", 0.0, open_low=True)


def limit(label: str, field: str, value: object, unit: str) -> None:
    """A time or count above zero."""
    within(label, field, value, unit, 0.0, open_low=True)


def known_keys(label: str, cls: type, data: Mapping[str, Any], also: tuple[str, ...] = ()) -> None:
    """Every key of `data` is a field of the dataclass `cls` or one of `also`."""
    allowed = [field.name for field in dataclasses.fields(cls)] + list(also)
    for key in data:
        if key not in allowed:
            raise MissionError(f"{label}: {unknown_name('key', str(key), allowed)}")


def required_keys(label: str, cls: type, data: Mapping[str, Any]) -> None:
    """Every field of `cls` without a default is in `data`."""
    for field in dataclasses.fields(cls):
        required = (
            field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )
        if required and field.name not in data:
            raise MissionError(f"{label}: {field.name} is missing; it has no default")
