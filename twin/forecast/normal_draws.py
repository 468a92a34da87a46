"""Normal draws: random draws of several numbers that vary together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def normal_draws(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    """Draws of mean 0, (count, size); the covariance (size, size) may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(
        rng.standard_normal((count, len(values))) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    )
