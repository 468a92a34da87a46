"""Numbers: a value that must be a number, whoever gave it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, shown

Array = NDArray[np.float64]


def number(value: object, what: str, error: type[InputError] = InputError) -> float:
    """`value` as a float; a whole number beyond all floats is infinite.

    Args:
      what: begins the message, such as "scenario: duration".

    Raises:
      InputError: (or `error`) it is a text, a truth value, None or anything else that is no number.
    """
    if not isinstance(value, bool) and hasattr(value, "__float__"):
        try:
            return float(value)
        except OverflowError:
            return math.inf
        except (TypeError, ValueError):  # an array of several, say
            pass
    raise error(f"{what} is {shown(value)}: give a number") from None


def numbers(values: object, what: str, error: type[InputError] = InputError) -> NDArray[np.float64]:
    """A list of numbers as an array.

    Raises:
      InputError: (or `error`) it is none, or holds something else; texts are no numbers.
    """
    if isinstance(values, str | bytes | dict):
        raise error(f"{what} is {shown(values)}: give numbers")
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise error(f"{what} is {shown(values)}: give numbers") from None
