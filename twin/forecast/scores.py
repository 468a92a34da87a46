"""Scores: by how much forecasts of surfacings miss, how sure that is, and whether ellipses hold."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.forecast.walk import HALF, NINETY, HindcastSurfacing

Array = NDArray[np.float64]

METHODS = ("forecast", "persistence", "no_current", "onboard")
RESAMPLED, BLOCK, SEED = 2000, 6, 1
"""Bootstrap samples, surfacings in a block (about a day: errors of neighbours are alike, Kunsch
1989, Ann. Stat. 17), and the seed"""
LEAST_BLOCKS, LEAST_SEGMENTS = 5, 12
"""Blocks of a deployment, which are shorter where it is short, and surfacings below which there are
no intervals: those resampled from fewer are too narrow"""
INTERVAL = (2.5, 97.5)
"""[%]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scores:
    """Of some surfacings; None where nothing could be scored."""

    segments: int
    """Surfacings scored"""
    segments_of: dict[str, int]
    """Of these, the surfacings that a method says anything of: its figures are of them alone"""
    mean: dict[str, float | None]
    """[m/h] by method"""
    median: dict[str, float | None]
    """[m/h] by method"""
    mean_interval: dict[str, tuple[float, float] | None]
    """[m/h] 95 % bootstrap interval of the mean, by method; None of fewer than `LEAST_SEGMENTS`,
    or where a method has only some of them"""
    ratio: float | None
    """[1] mean of the forecast by that of persistence"""
    ratio_interval: tuple[float, float] | None
    """[1] 95 % bootstrap interval of that"""
    coverage_50: float | None
    """[1] part of the fixes within the 50 % ellipse"""
    coverage_90: float | None

    @property
    def partial(self) -> tuple[str, ...]:
        """Methods that say something of some surfacings only."""
        return tuple(n for n, count in self.segments_of.items() if 0 < count < self.segments)

    def describe(self) -> dict[str, object]:
        """The figures with their units in the names."""
        return {
            "segments": self.segments,
            "segments_of": self.segments_of,
            "mean_m_per_h": self.mean,
            "median_m_per_h": self.median,
            "mean_interval_m_per_h": self.mean_interval,
            "forecast_by_persistence": self.ratio,
            "forecast_by_persistence_interval": self.ratio_interval,
            "coverage_50": self.coverage_50,
            "coverage_90": self.coverage_90,
        }


def scores_of(surfacings: Sequence[Sequence[HindcastSurfacing]]) -> Scores:
    """The scores of some deployments together.

    Args:
      surfacings: of each deployment; blocks of the bootstrap stay within one.
    """
    runs = [[one for one in run if one.scored] for run in surfacings]
    every = [one for run in runs for one in run]
    errors = {
        name: [np.array([one.error(name) for one in run]) for run in runs] for name in METHODS
    }
    joined = {name: np.concatenate([*values, np.zeros(0)]) for name, values in errors.items()}
    known = {name: values[np.isfinite(values)] for name, values in joined.items()}
    distances = np.array([one.distance for one in every])

    def ratio(sample: NDArray[np.intp]) -> float:
        return float(joined["forecast"][sample].mean() / joined["persistence"][sample].mean())

    enough = len(every) >= LEAST_SEGMENTS
    samples = _samples([len(run) for run in runs]) if enough else []
    return Scores(
        segments=len(every),
        segments_of={name: len(values) for name, values in known.items()},
        mean={n: float(v.mean()) if v.size else None for n, v in known.items()},
        median={n: float(np.median(v)) if v.size else None for n, v in known.items()},
        mean_interval={
            name: _interval(samples, _mean_of(joined[name]))
            if enough and len(known[name]) == len(every)
            else None
            for name in METHODS
        },
        ratio=ratio(np.arange(len(every))) if every else None,
        ratio_interval=_interval(samples, ratio) if enough else None,
        coverage_50=float(np.mean(distances <= HALF)) if every else None,
        coverage_90=float(np.mean(distances <= NINETY)) if every else None,
    )


def _mean_of(values: Array) -> Callable[[NDArray[np.intp]], float]:
    return lambda sample: float(values[sample].mean())


def _samples(counts: Sequence[int]) -> list[NDArray[np.intp]]:
    """Indices of bootstrap samples: blocks of neighbours, each deployment as long as it is."""
    rng = np.random.default_rng(SEED)
    found = []
    for _ in range(RESAMPLED):
        picked, first = [], 0
        for count in counts:
            if not count:
                continue
            block = min(BLOCK, max(count // LEAST_BLOCKS, 1))
            begins = rng.integers(0, count - block + 1, -(-count // block))
            rows = (begins[:, None] + np.arange(block)).ravel()[:count]
            picked.append(first + rows)
            first += count
        found.append(np.concatenate(picked))
    return found


def _interval(
    samples: Sequence[NDArray[np.intp]], figure: Callable[[NDArray[np.intp]], float]
) -> tuple[float, float]:
    low, high = np.percentile([figure(sample) for sample in samples], INTERVAL)
    return float(low), float(high)
