"""Statistics of an episode and of all, as LeRobot's policies scale with them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Statistics = dict[str, Array]

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def episode_statistics(values: NDArray[np.generic]) -> Statistics:
    """Of the columns of (samples, columns); NaN does not count.

    A column of nothing but NaN has zeros and a standard deviation of one, and counts zero samples.
    """
    known = np.asarray(values, float).reshape(len(values), -1)
    counts = np.isfinite(known).sum(axis=0)
    filled = np.where(counts > 0, known, 0.0)
    found = {
        "min": np.nanmin(filled, axis=0),
        "max": np.nanmax(filled, axis=0),
        "mean": np.nanmean(filled, axis=0),
        "std": np.where(counts > 0, np.nanstd(filled, axis=0), 1.0),
        "count": np.array([float(counts.max(initial=0))]),
    }
    parts = np.nanquantile(filled, list(QUANTILES.values()), axis=0)
    return found | dict(zip(QUANTILES, parts, strict=True))


class Total:
    """Statistics of all episodes from those of each, without their samples.

    Quantiles are the means of the episodes' own, by their lengths, as LeRobot makes them.
    """

    def __init__(self) -> None:
        self._found: dict[str, Statistics] = {}

    def add(self, episode: Mapping[str, Statistics]) -> None:
        """Take an episode's, by feature."""
        for name, new in episode.items():
            old = self._found.get(name)
            self._found[name] = dict(new) if old is None else _joined(old, new)

    def result(self) -> dict[str, dict[str, list[float]]]:
        """By feature and statistic, for stats.json."""
        return {
            name: {what: values.tolist() for what, values in found.items()}
            for name, found in self._found.items()
        }


def _joined(a: Statistics, b: Statistics) -> Statistics:
    """Of both together (Chan et al., 1979: the parallel algorithm for variances)."""
    count = a["count"] + b["count"]
    share = b["count"] / np.maximum(count, 1.0)
    apart = b["mean"] - a["mean"]
    variance = (1.0 - share) * a["std"] ** 2 + share * b["std"] ** 2
    found = {
        "min": np.minimum(a["min"], b["min"]),
        "max": np.maximum(a["max"], b["max"]),
        "mean": a["mean"] + share * apart,
        "std": np.sqrt(variance + share * (1.0 - share) * apart**2),
        "count": count,
    }
    return found | {name: a[name] + share * (b[name] - a[name]) for name in QUANTILES}
