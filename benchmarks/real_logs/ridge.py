"""Ridge regression on standardised inputs with their squares and products."""

from __future__ import annotations

import numpy as np

from twin.navigation.dead_reckoning import Array

PENALTY = 10.0
"""Squared weights count so much against squared errors [deviations]; results hardly change from 1
to 30."""
MOST = 4.0
"""Deviations at which inputs are cut off: the square of an outlier would rule the prediction."""


def ridge(train: Array, wanted: Array, test: Array, *, penalty: float = PENALTY) -> Array:
    """Prediction (n,) for test inputs (n, inputs) from a fit to train (m, inputs), wanted (m,)."""
    mean, scale = train.mean(0), train.std(0)
    scale = np.where(scale > 0.0, scale, 1.0)
    x, y = (_products(np.clip((v - mean) / scale, -MOST, MOST)) for v in (train, test))
    weights = penalty * np.eye(x.shape[1])
    weights[-1, -1] = 0.0  # the constant is free
    solved = np.linalg.solve(x.T @ x + weights, x.T @ wanted)
    return np.asarray(y @ solved, float)


def _products(x: Array) -> Array:
    """Columns, products of any two of them, and a constant."""
    count = x.shape[1]
    pairs = [x[:, i] * x[:, j] for i in range(count) for j in range(i, count)]
    return np.column_stack([x, *pairs, np.ones(len(x))])
