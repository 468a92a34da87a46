"""Drawn values: what the draws of a mission's parameters gave."""

from __future__ import annotations

import math
from collections.abc import Mapping

from factory.recipe.distribution import Value
from twin.errors import InputError

Drawn = Mapping[str, Value]
"""Values by name of the table; NaN where one is not used"""


def number(drawn: Drawn, name: str) -> float:
    """A value that must be a number; raises InputError for a word."""
    value = drawn[name]
    if isinstance(value, str):
        raise InputError(f"{name} = {value}: give numbers")
    return value


def limit(drawn: Drawn, name: str) -> float | None:
    """A value that may be left out: None where it is not drawn, or not used."""
    value = number(drawn, name) if name in drawn else math.nan
    return None if math.isnan(value) else value
