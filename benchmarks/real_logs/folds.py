"""Folds: dives of a deployment held out in blocks, and the twin identified on the others."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.real_logs.public import SteadyModel, fit_steady
from benchmarks.real_logs.source import Deployment
from twin.errors import InputError
from twin.identify import Calibration, identify, load_calibration, load_logs

BLOCKS = 4
"""Held-out blocks: of 24 segments 6 at a time."""
MOST_ROWS = 24
"""Dives that one identification looks at, so that a long deployment takes no longer."""
RUN = 6
"""Consecutive dives taken together when a long deployment is thinned: currents are compared from
one dive to the next."""
LEAST_ROWS = 4
"""Dives of a deployment below which nothing is held out."""


def blocks(rows: Sequence[int], count: int = BLOCKS) -> list[tuple[int, ...]]:
    """Rows in `count` blocks of consecutive ones, each once."""
    count = min(count, len(rows))
    return [tuple(int(r) for r in part) for part in np.array_split(np.asarray(rows), count)]


def thinned(rows: Sequence[int], most: int = MOST_ROWS) -> list[int]:
    """At most `most` of the rows, as runs of consecutive ones spread evenly."""
    if len(rows) <= most:
        return list(rows)
    count = most // RUN
    starts = np.linspace(0, len(rows) - RUN, count).round().astype(int)
    return sorted({rows[s + k] for s in starts for k in range(RUN)})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fitted:
    """What was tuned without the block's dives."""

    block: tuple[int, ...]
    calibration: Calibration
    steady: SteadyModel


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoldJob:
    """One identification, as a process can be given it."""

    store: Path
    block: tuple[int, ...]
    train: tuple[int, ...]
    vehicle: str
    fixes: bool = True


def jobs(
    deployment: Deployment, rows: Sequence[int], vehicle: str, count: int = BLOCKS
) -> list[FoldJob]:
    """One job per block."""
    return [
        FoldJob(
            store=deployment.store,
            block=block,
            train=tuple(thinned([r for r in rows if r not in block])),
            vehicle=vehicle,
        )
        for block in blocks(rows, count)
    ]


def fit_fold(job: FoldJob) -> Fitted:
    """Identify on the training rows; errors as `identify`."""
    logs = load_logs(job.store, list(job.train))
    found = identify(logs, load_calibration(job.vehicle), fixes=job.fixes)
    return Fitted(
        block=job.block, calibration=found.calibration, steady=fit_steady(logs, found.nominal)
    )


def fold_of(fitted: Sequence[Fitted], row: int) -> Fitted:
    """The fold that holds a row out."""
    for fold in fitted:
        if row in fold.block:
            return fold
    raise InputError(f"row {row} is in no fold")
