"""Durations: times that a person types, as 90min, 6h or 2d, or as a number in the option's unit."""

from __future__ import annotations

import math
import re
from typing import Annotated

from tyro.constructors import PrimitiveConstructorSpec

from twin.errors import InputError

SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""[s] of each unit that can stand behind a number"""
NOT_FINITE = ("nan", "inf", "-inf")
"""Numbers that no duration is, as they are written"""
METAVAR = "DURATION"
"""What a help text shows for one"""
_WRITTEN = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*([a-z]*)", re.IGNORECASE)


def duration(text: str, unit: str) -> float:
    """A duration in a unit.

    Args:
      text: such as 6h, 90min, 45s or 2d; a bare number is in `unit`.
      unit: s, min, h or d.

    Raises:
      InputError: no number, or another unit.
    """
    found = _read(text, unit)
    if found is None:
        raise InputError(f"{text!r} {_NONE} {unit}")
    return found


_NONE = (
    "is no duration: give a number with s, min, h or d, such as 6h or 90min; a bare number is in"
)


def _read(text: str, unit: str) -> float | None:
    found = _WRITTEN.fullmatch(text.strip())
    if found is None or not math.isfinite(float(found[1])):
        return None
    own = found[2].lower() or unit
    if own not in SECONDS:
        return None
    return float(found[1]) if own == unit else float(found[1]) * SECONDS[own] / SECONDS[unit]


SPELLED = {
    "s": "s", "sec": "s", "second": "s", "min": "min", "minute": "min", "h": "h", "hr": "h",
    "hour": "h", "d": "d", "day": "d", "week": None, "month": None, "year": None,
}  # fmt: skip
"""Words for a time, without the s of many, and the unit that each is, if any"""


def apart(number: str, word: str) -> str | None:
    """What is wrong with a duration that was typed as two words; None where they are none.

    Args:
      number: what was given as a duration.
      word: what was typed behind it, such as weeks.
    """
    found = _WRITTEN.fullmatch(number)
    spoken = word.lower()
    spoken = spoken if spoken in SPELLED else spoken.removesuffix("s")
    if found is None or found[2] or spoken not in SPELLED:
        return None
    unit = SPELLED[spoken]
    right = f"{number}{unit}" if unit else "42d"
    return (
        f"'{number} {word}' is no duration: write number and unit as one word, with s, min, h or "
        f"d, such as {right}"
    )


def _typed(words: list[str], unit: str) -> float:
    found = _read(words[0], unit)
    if found is None and words[0].strip().lower() in NOT_FINITE:
        return float(words[0])  # whoever takes the duration says what it may be
    if found is None:  # the parser's own message names the option
        raise ValueError(f"{words[0]!r} {_NONE} {unit}")
    return found


def _option(unit: str) -> PrimitiveConstructorSpec[float]:
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{METAVAR}[{unit}]",
        instance_from_str=lambda words: _typed(words, unit),
        is_instance=lambda value: isinstance(value, int | float),
        str_from_instance=lambda value: [f"{value:g}{unit}"],
    )


Seconds = Annotated[float, _option("s")]
"""Type of an option: [s]; a bare number is in seconds"""
Hours = Annotated[float, _option("h")]
"""Type of an option: [h]; a bare number is in hours"""
