"""Forecast: a current and the displacement by it at later times, with their covariances."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class CurrentForecast:
    """What a filter expects."""

    times: Array
    """[s] on the filter's clock, (time,)"""
    current: Array
    """North, east [m/s], (time, 2)"""
    current_covariance: Array
    """[m2/s2], (time, 2, 2)"""
    displacement: Array
    """North, east [m] beyond the way through the water since the filter's time, (time, 2)"""
    displacement_covariance: Array
    """[m2], (time, 2, 2)"""
