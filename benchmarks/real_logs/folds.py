"""Folds: held-out blocks of a deployment's dives, and the twin identified on the other dives."""

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
"""Number of held-out blocks: 6 dives each, of 24"""
MOST_ROWS = 24
"""Most dives in one identification, so that a long deployment takes no longer"""
RUN = 6
"""Consecutive dives that stay together when a long deployment is thinned: currents are compared
from one dive to the next."""
LEAST_LATER = 3
"""Fewest dives of each half for a prediction of later dives from earlier ones"""
LEAST_ROWS = 4
"""Fewest dives of a deployment for dives to be held out"""


def blocks(rows: Sequence[int], count: int = BLOCKS) -> list[tuple[int, ...]]:
    """Divide rows into `count` blocks of consecutive rows."""
    count = min(count, len(rows))
    return [tuple(int(r) for r in part) for part in np.array_split(np.asarray(rows), count)]


def thinned(rows: Sequence[int], most: int = MOST_ROWS) -> list[int]:
    """Choose at most `most` rows, in evenly spread runs of consecutive rows."""
    if len(rows) <= most:
        return list(rows)
    count = most // RUN
    starts = np.linspace(0, len(rows) - RUN, count).round().astype(int)
    return sorted({rows[s + k] for s in starts for k in range(RUN)})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fitted:
    """Models tuned without the block's dives; or on the dives themselves, if `seen`."""

    block: tuple[int, ...]
    calibration: Calibration
    blind: Calibration
    """Calibration by the depth rate only, without fixes, if the job asks for it"""
    steady: SteadyModel
    seen: bool = False
    """True: too few dives to hold one out; the models are tuned on the block itself"""
    later: bool = False
    """True: the models are tuned on the first half of the dives; the block is the second half"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoldJob:
    """One identification, in a form that can be sent to a process."""

    store: Path
    block: tuple[int, ...]
    train: tuple[int, ...]
    later: bool = False
    """True: train on the first half of the dives; the block is the second half"""
    blind: bool = False
    """True: identify without the fixes too"""


def later_job(deployment: Deployment, rows: Sequence[int]) -> list[FoldJob]:
    """Make the job that tunes on the first half of the dives and scores the second half; none for
    too few dives."""
    half = len(rows) // 2
    if len(rows) < 2 * LEAST_LATER:
        return []
    train = tuple(thinned(rows[:half]))
    return [FoldJob(store=deployment.store, block=tuple(rows[half:]), train=train, later=True)]


def jobs(deployment: Deployment, rows: Sequence[int], count: int = BLOCKS) -> list[FoldJob]:
    """Make one job per block; with too few dives, one job on the dives themselves."""
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
    """Calibration with the trim of one dive, fitted to its depth rate."""
    try:
        return identify([log], calibration, parameters=["neutral_density"], fixes=False).calibration
    except InputError:  # too little steady flight
        return calibration


def fold_of(fitted: Sequence[Fitted], row: int) -> Fitted:
    """Return the fold that holds a row out."""
    for fold in fitted:
        if row in fold.block and not fold.later:
            return fold
    raise InputError(f"row {row} is in no fold")
