"""Intervals: how sure an error is, by bootstrap over the dives that it was measured on.

Samples of one dive share water, trim and whatever a method lacks on that day. Whole dives are drawn
with replacement, and the figure is worked out for each draw (Efron and Tibshirani 1993).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.navigation.dead_reckoning import Array

DRAWS = 2000
SEED = 20221123
"""Intervals are the same in every run."""
CENTRAL = (2.5, 97.5)
"""[%] the interval that is stated: 95 %"""
LEAST_DIVES = 4
"""Dives below which none is stated."""

Interval = tuple[float, float]
UNKNOWN: Interval = (float("nan"), float("nan"))


def rmse_interval(dives: Sequence[Array]) -> Interval:
    """95 % interval of the RMSE over all samples; NaN for too few dives.

    Args:
      dives: errors of each dive, finite.
    """
    known = [dive for dive in dives if dive.size]
    squares = np.array([float(np.sum(dive**2)) for dive in known])
    counts = np.array([dive.size for dive in known], float)
    if len(known) < LEAST_DIVES:
        return UNKNOWN
    drawn = _draws(len(known))
    found = np.sqrt(squares[drawn].sum(axis=1) / counts[drawn].sum(axis=1))
    low, high = np.percentile(found, CENTRAL)
    return float(low), float(high)


def median_interval(errors: Array) -> Interval:
    """95 % interval of the median over dives, one error each; NaN for too few."""
    if errors.size < LEAST_DIVES:
        return UNKNOWN
    low, high = np.percentile(np.median(errors[_draws(errors.size)], axis=1), CENTRAL)
    return float(low), float(high)


def pooled_draws(groups: Sequence[Sequence[Array]]) -> Array:
    """RMSE over deployments that count alike, however many samples each has, (1 + draws,): of all
    dives, then of each draw of dives within their deployments; NaN for too few dives.

    The draws are the same for every method, so that the ratio of two methods has an interval.

    Args:
      groups: errors of each dive of each deployment, finite.
    """
    squares = np.zeros(1 + DRAWS)
    for group, dives in enumerate(groups):
        if len(dives) < LEAST_DIVES:
            return np.full(1 + DRAWS, np.nan)
        drawn = np.vstack([np.arange(len(dives)), _draws(len(dives), group)])
        sums = np.array([float(np.sum(dive**2)) for dive in dives])
        counts = np.array([dive.size for dive in dives], float)
        squares += sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1) / len(groups)
    return np.sqrt(squares)


def central(draws: Array) -> Interval:
    """95 % interval of a figure from its draws."""
    low, high = np.percentile(draws, CENTRAL)
    return float(low), float(high)


def _draws(dives: int, group: int = 0) -> np.ndarray:
    """Numbers of the dives of each draw, (draws, dives)."""
    return np.random.default_rng(SEED + group).integers(0, dives, (DRAWS, dives))
