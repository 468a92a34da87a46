"""Blocks: deviations of a fit by bootstrap over the dives that it was made from.

Dives of one log share water, trim and whatever the model lacks on that day, so that their samples
are not independent: whole dives are drawn with replacement (Kuensch 1989), and each draw is
fitted by one Gauss-Newton step from the fit to all. What was known before is drawn too, from its
own spread, so that a parameter that the dives do not determine keeps the deviation it had.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Blocks = NDArray[np.int_]

PRIOR = -1
"""Block of the residuals that are what was known before."""
DRAWS = 400
LEAST_BLOCKS = 8
"""Fewer dives are cut into parts: draws of three dives say little about their spread."""
SEED = 20221123
"""Deviations are the same in every run."""


def cut(blocks: Blocks) -> Blocks:
    """The dives of residuals, cut in equal parts where they are fewer than LEAST_BLOCKS."""
    numbers = np.unique(blocks[blocks != PRIOR])
    parts = -(-LEAST_BLOCKS // max(len(numbers), 1))
    if parts == 1:
        return blocks
    out = blocks.copy()
    for number in numbers:
        rows = np.flatnonzero(blocks == number)
        for k, piece in enumerate(np.array_split(rows, parts)):
            out[piece] = parts * number + k
    return out


def bootstrap(jacobian: Array, residual: Array, blocks: Blocks) -> Array:
    """Covariance of the offsets by block bootstrap, (parameters, parameters).

    Args:
      jacobian: (residuals, parameters), weighted, at the fit.
      residual: (residuals,), weighted.
      blocks: (residuals,) the dive of each; PRIOR: what was known before.
    """
    blocks = cut(blocks)
    numbers = np.unique(blocks[blocks != PRIOR])
    size = jacobian.shape[1]
    curve, slope = np.zeros((len(numbers), size, size)), np.zeros((len(numbers), size))
    for k, number in enumerate(numbers):
        rows = blocks == number
        curve[k] = jacobian[rows].T @ jacobian[rows]
        slope[k] = jacobian[rows].T @ residual[rows]
    known = jacobian[blocks == PRIOR]
    kept = residual[blocks == PRIOR]
    rng = np.random.default_rng(SEED)
    offsets = np.empty((DRAWS, size))
    for draw in range(DRAWS):
        count = np.bincount(rng.integers(0, len(numbers), len(numbers)), minlength=len(numbers))
        drawn = rng.normal(size=len(kept))
        matrix = np.tensordot(count, curve, axes=1) + known.T @ known
        right = count @ slope + known.T @ (kept + drawn)
        offsets[draw] = -np.linalg.solve(matrix, right)
    covariance = np.atleast_2d(np.cov(offsets, rowvar=False))
    # draws of n blocks scatter by (n - 1) / n of the variance
    return np.asarray(covariance * len(numbers) / max(len(numbers) - 1, 1), np.float64)
