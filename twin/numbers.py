"""Numbers: checked conversion to float, small linear algebra, and the number of processors.

Linear algebra libraries round differently on different processors. Values that decide a flight's
bytes, such as the gains of guidance, go through `product` and `solved_system` instead.
"""

from __future__ import annotations

import math
import os

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, shown

Array = NDArray[np.float64]


def number(value: object, what: str, error: type[InputError] = InputError) -> float:
    """Convert `value` to a float; an integer too large for a float becomes infinite.

    Args:
      what: start of the message, such as "scenario: duration".

    Raises:
      InputError: (or `error`) `value` is no number, such as a text, a truth value or None.
    """
    if not isinstance(value, bool) and hasattr(value, "__float__"):
        try:
            return float(value)
        except OverflowError:
            return math.inf
        except (TypeError, ValueError):  # such as an array of several numbers
            pass
    raise error(f"{what} is {shown(value)}: give a number") from None


def numbers(values: object, what: str, error: type[InputError] = InputError) -> NDArray[np.float64]:
    """Convert a list of numbers to an array.

    Raises:
      InputError: (or `error`) `values` is no list of numbers; texts are no numbers.
    """
    if isinstance(values, str | bytes | dict):
        raise error(f"{what} is {shown(values)}: give numbers")
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise error(f"{what} is {shown(values)}: give numbers") from None


def product(matrix: Array, vector: Array) -> Array:
    """Matrix times vector, shape (rows,), with identical bits on every processor.

    Args:
      matrix: shape (rows, columns) with fewer than eight columns, which NumPy sums in order.
    """
    total: Array = (matrix * vector).sum(axis=1)
    return total


def solved_system(matrix: Array, right: Array) -> Array | None:
    """Solution of `matrix @ x = right`, shape (n,), with identical bits on every processor.

    The method is Gaussian elimination with partial pivoting; None if the matrix is singular.

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
    """Number of processors that this process may use; all if the system cannot limit them."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # only Linux has this function
        return os.cpu_count() or 1
