"""Layout: where each number is in the state of a current filter, and what may be given for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError

Array = NDArray[np.float64]

POSITION, CALIBRATION, DIVE = slice(0, 2), slice(2, 4), slice(4, 6)
"""North, east [m]; relative error of the speed [1] and offset of the compass [rad]; what the dive
under way adds, north and east [m/s]"""
MODES = 6
"""Index of the first mode's north."""


def even(matrix: Array) -> Array:
    """A covariance without the skew part that rounding has made."""
    return 0.5 * (matrix + matrix.T)


def pair(values: ArrayLike, what: str) -> Array:
    """North and east, (2,).

    Raises:
      InputError: they are not two finite numbers.
    """
    found = np.asarray(values, float)
    if found.shape != (2,) or not np.isfinite(found).all():
        raise InputError(f"a {what} is north and east, two finite numbers, not {values!r}")
    return found


def square(values: ArrayLike, what: str) -> Array:
    """A matrix of north and east, (2, 2).

    Raises:
      InputError: it is of another shape or not finite.
    """
    found = np.asarray(values, float)
    if found.shape != (2, 2) or not np.isfinite(found).all():
        raise InputError(f"a {what} is a finite matrix of 2 by 2, not {values!r}")
    return found
