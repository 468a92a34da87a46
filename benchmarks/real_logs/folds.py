"""Folds: dives of a deployment held out in blocks, and the twin identified on the others."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.real_logs.public import SteadyModel, fit_steady
from benchmarks.real_logs.source import Deployment
from twin.errors import InputError
from twin.identify import Calibration, Log, identify, load_calibration, load_logs
from twin.identify.logged_missions import start_vehicle

BLOCKS = 4
"""Held-out blocks: of 24 segments 6 at a time."""
MOST_ROWS = 24
"""Dives that one identification looks at, so that a long deployment takes no longer."""
RUN = 6
"""Consecutive dives taken together when a long deployment is thinned: currents are compared from
one dive to the next."""
LEAST_LATER = 3
"""Dives of a half below which later dives are not foretold by earlier ones."""
LEAST_ROWS = 4
"""Dives of a deployment below which none is held out."""


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
    """What was tuned without the block's dives, or on them where `seen`."""

    block: tuple[int, ...]
    calibration: Calibration
    blind: Calibration
    """The same without the fixes, depth rate alone, where the job asks for it"""
    steady: SteadyModel
    seen: bool = False
    """Too few dives to hold one out: tuned on the block itself"""
    later: bool = False
    """Tuned on the first half of the dives; the block is the second"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoldJob:
    """One identification, as a process can be given it."""

    store: Path
    block: tuple[int, ...]
    train: tuple[int, ...]
    later: bool = False
    """The train is the first half of the dives, the block the second"""
    blind: bool = False
    """Identify without the fixes too"""


def later_job(deployment: Deployment, rows: Sequence[int]) -> list[FoldJob]:
    """One job that is tuned on the first half of the dives and judged on the second; none for
    too few."""
    half = len(rows) // 2
    if len(rows) < 2 * LEAST_LATER:
        return []
    train = tuple(thinned(rows[:half]))
    return [FoldJob(store=deployment.store, block=tuple(rows[half:]), train=train, later=True)]


def jobs(deployment: Deployment, rows: Sequence[int], count: int = BLOCKS) -> list[FoldJob]:
    """One job per block; one with the dives themselves where they are too few to hold any out."""
    if len(rows) < LEAST_ROWS:
        return [FoldJob(store=deployment.store, block=tuple(rows), train=tuple(rows))]
    return [
        FoldJob(
            store=deployment.store,
            block=block,
            train=tuple(thinned([r for r in rows if r not in block])),
        )
        for block in blocks(rows, count)
    ]


def fit_fold(job: FoldJob) -> Fitted:
    """Identify on the training rows, as `twin identify` does; errors as `identify`."""
    logs = load_logs(job.store, list(job.train))
    nominal = load_calibration(start_vehicle(job.store))
    found = identify(logs, nominal)
    blind = found
    if job.blind and found.current_change is not None:
        blind = identify(logs, nominal, fixes=False)
    return Fitted(
        block=job.block,
        calibration=found.calibration,
        blind=blind.calibration,
        steady=fit_steady(logs, found.nominal),
        seen=job.block == job.train,
        later=job.later,
    )


def own_trim(log: Log, calibration: Calibration) -> Calibration:
    """The calibration with the trim of one dive, fitted to its depth rate."""
    try:
        return identify([log], calibration, parameters=["neutral_density"], fixes=False).calibration
    except InputError:  # too little steady flight
        return calibration


def fold_of(fitted: Sequence[Fitted], row: int) -> Fitted:
    """The fold that holds a row out."""
    for fold in fitted:
        if row in fold.block and not fold.later:
            return fold
    raise InputError(f"row {row} is in no fold")
