"""Checks that every sensor configuration and every truth record passes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.numbers import Array, number

Signals = Mapping[str, NDArray[Any]]
Drawn = Mapping[str, float]


def _values(config: Any, name: str) -> Iterable[float]:
    """The numbers of a field, which has several where its default has or may have."""
    value = getattr(config, name)
    (declared,) = (f for f in dataclasses.fields(config) if f.name == name)
    several = isinstance(value, tuple) and (
        isinstance(declared.default, tuple) or "tuple" in str(declared.type)
    )
    label = f"{type(config).__name__}.{name}"
    return [number(one, label) for one in (value if several else (value,))]


def require_non_negative(config: Any, *names: str) -> None:
    """Raise InputError unless each named field is finite and at least 0."""
    for name in names:
        for value in _values(config, name):
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(
                    f"{type(config).__name__}.{name} is {value:g}: it must be finite and at least 0"
                )


def require_positive(config: Any, *names: str) -> None:
    """Raise InputError unless each named field is above 0 (infinity is allowed)."""
    for name in names:
        for value in _values(config, name):
            if not value > 0.0:
                raise InputError(f"{type(config).__name__}.{name} is {value:g}: it must be above 0")


def require_finite(config: Any, *names: str) -> None:
    """Raise InputError unless each named field is finite."""
    for name in names:
        for value in _values(config, name):
            if not math.isfinite(value):
                raise InputError(f"{type(config).__name__}.{name} is {value:g}: it must be finite")


def drawn_value(drawn: Drawn, name: str) -> float:
    """The value that a mission drew for `name`; a missing one names its nearest neighbour."""
    try:
        return float(drawn[name])
    except KeyError:
        raise InputError(unknown_name("drawn sensor value", name, drawn)) from None


def signal(truth: Signals, name: str) -> Array:
    """truth[name] as a contiguous float64 vector, without a copy where it is one already."""
    try:
        array = truth[name]
    except KeyError:
        raise InputError(
            f"truth lacks {name!r}, which the sensors need: add it to the recorded signals"
        ) from None
    return np.ascontiguousarray(array, dtype=np.float64)
