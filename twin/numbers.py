"""Numbers: a value that must be a number, whoever gave it; small systems of them; processors.

A library of linear algebra rounds otherwise on another processor. What decides a flight's bytes,
such as the gains of guidance, goes through `product` and `solved_system` instead.
"""

from __future__ import annotations

import math
import os

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


def product(matrix: Array, vector: Array) -> Array:
    """Matrix times vector, shape (rows,), with the same bits on every processor.

    Args:
      matrix: shape (rows, columns) with less than eight columns, which NumPy adds up in order.
    """
    total: Array = (matrix * vector).sum(axis=1)
    return total


def solved_system(matrix: Array, right: Array) -> Array | None:
    """Solution of `matrix @ x = right`, shape (n,), with the same bits on every processor.

    Gaussian elimination with partial pivoting. None: the matrix is singular.

    Args:
      matrix: shape (n, n). right: shape (n,).
    """
    rows = [[*row, value] for row, value in zip(matrix.tolist(), right.tolist(), strict=True)]
    count = len(rows)
    for k in range(count):
        pivot = max(range(k, count), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        if not rows[k][k]:
            return None
        for i in range(k + 1, count):
            factor = rows[i][k] / rows[k][k]
            for j in range(k, count + 1):
                rows[i][j] -= factor * rows[k][j]
    found = [0.0] * count
    for k in reversed(range(count)):
        known = sum(rows[k][j] * found[j] for j in range(k + 1, count))
        found[k] = (rows[k][count] - known) / rows[k][k]
    return np.array(found)


def processors() -> int:
    """Processors that this process may use, at least 1; where the system does not say, all."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # Linux alone has it
        return os.cpu_count() or 1
