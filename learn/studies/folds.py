"""Folds: leave one dive out, train on the others, judge the dive by what never saw it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from learn.data.dataset import TARGETS, load_missions
from learn.data.features import channels_of
from learn.data.logs import SPEED
from learn.files import write_json
from learn.runs.run import Run
from learn.training.fitting import Watch, fit
from learn.training.settings import FitConfig
from twin.cli.console import to_json
from twin.errors import InputError
from twin.records.reader import MissionStore

FOLDS = "leave-out-each-dive.json"
LEAST_DIVES = 3
"""One to judge, one to validate, one to train."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fold:
    """One dive, judged by networks that were trained on the others."""

    row: int
    samples: int
    """With truth."""
    squared: float
    """[(m/s)^2] sum over them, surge"""


@dataclasses.dataclass(frozen=True)
class Folds:
    """All dives of a store."""

    folds: tuple[Fold, ...]

    @property
    def rmse(self) -> float:
        """[m/s] of surge over all samples with truth"""
        return math.sqrt(sum(f.squared for f in self.folds) / sum(f.samples for f in self.folds))

    def rows(self) -> list[dict[str, object]]:
        """For a table."""
        return [
            {
                "row": fold.row,
                "samples": fold.samples,
                "surge RMSE [m/s]": math.sqrt(fold.squared / fold.samples),
            }
            for fold in self.folds
        ]

    def sentence(self) -> str:
        """The result in words."""
        return (
            f"Leave one dive out: surge {self.rmse:.3g} m/s RMSE over "
            f"{sum(f.samples for f in self.folds)} samples of {len(self.folds)} dives."
        )

    def to_json(self) -> dict[str, Any]:
        """For programs."""
        found: dict[str, Any] = to_json({"surge_rmse": self.rmse, "folds": list(self.folds)})
        return found


def dives_with_truth(config: FitConfig) -> list[int]:
    """Rows of a store of logs that have a truth of surge.

    Raises:
      InputError: the store is simulated, or too few rows have truth.
    """
    missions = load_missions(config.store, _truth_channels(config.store), split="all")
    rows = [m.index for m in missions if m.row is not None and np.isfinite(m.target("surge")).any()]
    if len(rows) < LEAST_DIVES:
        raise InputError(
            f"store {config.store} has {len(rows)} dives of real logs with truth; leaving one out "
            f"needs at least {LEAST_DIVES}"
        )
    return rows


def leave_out_each(
    run: Run,
    config: FitConfig,
    dives: Sequence[int],
    *,
    workers: int = 2,
    watch: Watch | None = None,
) -> Folds:
    """Train without each dive, in folders of their own inside the run, and judge it.

    What is there already is kept. The figures are written to `leave-out-each-dive.json`.
    """
    folds = []
    for row in dives:
        settings = dataclasses.replace(config, held_out=(row,))
        part = fit(
            settings, run.folder / f"without-{row}", resume=True, workers=workers, watch=watch
        )
        networks = part.networks()
        channels = [*channels_of(config.features), *_truth_channels(config.store)]
        missions = load_missions(config.store, channels, split="all", period=config.period)
        judged = [m for m in missions if m.index == row]
        mean, _ = networks["surge"].predict(judged)[0]
        error = np.asarray(mean, float) - judged[0].target("surge")
        known = np.isfinite(error)
        folds.append(
            Fold(row=row, samples=int(known.sum()), squared=float(np.square(error[known]).sum()))
        )
    found = Folds(tuple(folds))
    write_json(run.folder / FOLDS, found.to_json())
    return found


def _truth_channels(store: str) -> list[str]:
    """Channels of truth that a store has; a simulated one has both velocities."""
    with MissionStore(store) as reader:
        names = (*TARGETS.values(), SPEED) if reader.logged else tuple(TARGETS.values())
        found = [name for name in names if name in reader]
    if not found:
        raise InputError(f"store {store} has no truth (none of {', '.join(names)})")
    return found
