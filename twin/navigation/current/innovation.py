"""Innovation: by how much a fix differs from what a filter expected."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Innovation:
    """Of one fix."""

    residual: Array
    """North, east [m], (2,): fix less prediction"""
    covariance: Array
    """[m2], (2, 2), of the prediction and the fix"""
    distance: float
    """[1] squared Mahalanobis distance"""
    duration: float
    """[s] since the fix before"""
