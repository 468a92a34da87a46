"""Scores: by how much forecasts miss, how sure that is, and whether ellipses hold."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.walk import Judged

METHODS = ("forecast", "persistence", "tide", "no_current", "onboard")
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
    rival: str | None
    """The method beside the forecast with the smallest mean, of those that say something of every
    surfacing"""
    ratio: float | None
    """[1] mean of the forecast by that of the rival"""
    ratio_interval: tuple[float, float] | None
    """[1] 95 % bootstrap interval of that; None of fewer than `LEAST_SEGMENTS`"""
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
            "mean_m_per_h": self.mean,
            "median_m_per_h": self.median,
            "coverage_50": self.coverage_50,
            "coverage_90": self.coverage_90,
        }


def scores_of(deployments: Sequence[Sequence[Judged]]) -> Scores:
    """The scores of some deployments together.

    Args:
      deployments: what was scored of each; blocks of the bootstrap stay within one.
    """
    every = [one for run in deployments for one in run]
    errors = {name: np.array([one.error(name) for one in every]) for name in METHODS}
    known = {name: values[np.isfinite(values)] for name, values in errors.items()}
    mean = {n: float(v.mean()) if v.size else None for n, v in known.items()}
    whole = {
        name: figure
        for name, figure in mean.items()
        if name != "forecast" and figure is not None and len(known[name]) == len(every)
    }
    rival = min(whole, key=lambda name: whole[name]) if whole else None
    interval = None
    if rival is not None and len(every) >= LEAST_SEGMENTS:
        interval = bootstrap(
            [len(run) for run in deployments],
            lambda rows: float(errors["forecast"][rows].mean() / errors[rival][rows].mean()),
        )
    held = np.array([one.held for one in every], float).reshape(-1, 2)
    return Scores(
        segments=len(every),
        segments_of={name: len(values) for name, values in known.items()},
        mean=mean,
        median={n: float(np.median(v)) if v.size else None for n, v in known.items()},
        rival=rival,
        ratio=None if rival is None else float(errors["forecast"].mean()) / whole[rival],
        ratio_interval=interval,
        coverage_50=float(held[:, 0].mean()) if every else None,
        coverage_90=float(held[:, 1].mean()) if every else None,
    )


def bootstrap(
    counts: Sequence[int],
    figure: Callable[[NDArray[np.intp]], float],
    interval: tuple[float, float] = INTERVAL,
) -> tuple[float, float]:
    """Interval of a figure, resampled in blocks of neighbours, each deployment as long as it is.

    Args:
      counts: surfacings of each deployment, one after the other.
      figure: of the surfacings at some indices.
      interval: [%] its two percentiles.
    """
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
        found.append(figure(np.concatenate(picked)))
    low, high = np.percentile(found, interval)
    return float(low), float(high)
