"""Rewards: soft indicators of whether a number is within bounds.

The shapes equal those of `dm_control.utils.rewards` (Tassa et al. 2018, DeepMind Control Suite,
arXiv:1801.00690), number for number; only the shapes that the tasks use are here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from twin.errors import InputError, unknown_name

AT_MARGIN = 0.1
"""Default value of a reward at the distance `margin` from the bounds."""


def _gaussian(x: Any, at_margin: float) -> Any:
    scale = np.sqrt(-2 * np.log(at_margin))
    return np.exp(-0.5 * (x * scale) ** 2)


def _long_tail(x: Any, at_margin: float) -> Any:
    scale = np.sqrt(1 / at_margin - 1)
    return 1 / ((x * scale) ** 2 + 1)


def _linear(x: Any, at_margin: float) -> Any:
    scaled = x * (1 - at_margin)
    return np.where(abs(scaled) < 1, 1 - scaled, 0.0)


SIGMOIDS: dict[str, Callable[[Any, float], Any]] = {
    "gaussian": _gaussian,
    "long_tail": _long_tail,
    "linear": _linear,
}
"""Decrease of a reward with distance / margin: 1 at 0, `value_at_margin` at 1."""


def tolerance(
    x: Any,
    bounds: tuple[float, float] = (0.0, 0.0),
    margin: float = 0.0,
    sigmoid: str = "gaussian",
    value_at_margin: float = AT_MARGIN,
) -> Any:
    """Return 1 within the bounds, falling to `value_at_margin` at the distance `margin` from them.

    Args:
      x: a number, or an array of any shape; the result has its shape.
      bounds: ends of the interval, which may be infinite or equal, in the unit of `x`.
      margin: in the unit of `x`; with 0 the result is 0 outside of the bounds.
      sigmoid: one of SIGMOIDS.
      value_at_margin: above 0 and below 1; for `linear` also 0.

    Raises:
      InputError: impossible bounds, margin, sigmoid or value.
    """
    lower, upper = bounds
    if not lower <= upper:
        raise InputError(f"bounds {lower} to {upper}: the lower one must not be above the upper")
    if not margin >= 0:
        raise InputError(f"margin {margin} must not be negative")
    if sigmoid not in SIGMOIDS:
        raise InputError(unknown_name("sigmoid", sigmoid, SIGMOIDS))
    if not (0 < value_at_margin < 1 or (sigmoid == "linear" and value_at_margin == 0)):
        raise InputError(f"value_at_margin {value_at_margin} must be above 0 and below 1")
    within = np.logical_and(lower <= x, x <= upper)
    if margin == 0:
        value = np.where(within, 1.0, 0.0)
    else:
        distance = np.where(x < lower, lower - x, x - upper) / margin
        value = np.where(within, 1.0, SIGMOIDS[sigmoid](distance, value_at_margin))
    return float(value) if np.isscalar(x) else value
