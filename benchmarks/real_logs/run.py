"""Run: all tasks of a folder, the long work side by side in processes."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.real_logs import adcp, dvl, fixes, left_out, surge_networks
from benchmarks.real_logs.folds import fit_fold
from benchmarks.real_logs.row import Row
from benchmarks.real_logs.source import Deployment, gather
from benchmarks.real_logs.surge_networks import Pretrained
from learn.training.resources import end_with
from twin.errors import TwinError

Say = Callable[[str], None]
Done = Callable[[float], None]
Input = TypeVar("Input")
Output = TypeVar("Output")

SHARES = {
    "import": 0.03,
    "simulate": 0.17,
    "speed": 0.05,
    "left-out": 0.05,
    "fixes": 0.35,
    "surge": 0.35,
}
"""Parts of the whole time, roughly, for the progress."""
RATES = (fixes.RATE, fixes.RATE_GLIDING, fixes.RATE_LATER, fixes.RATE_FACTORY)
SECTIONS = {
    "speed": (dvl.TASK,),
    "fixes": (*RATES, fixes.TRACK),
    "surge": (adcp.TASK,),
    "left-out": (left_out.TASK, left_out.RATIO),
}
"""Tasks that are judged together, each a table"""
TASKS = (
    *(task for n in ("speed", "surge", "left-out", "fixes") for task in SECTIONS[n]),
    "skipped",
)
"""Order of the tables."""


@dataclasses.dataclass(frozen=True)
class Failure:
    """Why a job gave nothing."""

    why: str


class Pool:
    """Processes of one thread each; one worker works in this process."""

    def __init__(self, workers: int) -> None:
        self._pool = None
        if workers > 1:
            context = multiprocessing.get_context("spawn")
            self._pool = concurrent.futures.ProcessPoolExecutor(
                workers, mp_context=context, initializer=end_with, initargs=(os.getpid(),)
            )

    def run(
        self, function: Callable[[Input], Output], jobs: Sequence[Input], done: Done
    ) -> list[Output | Failure]:
        """Results in the order of the jobs; `done` is told each job's part of the whole."""
        if self._pool is None:
            found = []
            for job in jobs:
                found.append(_guarded(function, job))
                done(1.0 / len(jobs))
            return found
        futures = [self._pool.submit(_guarded, function, job) for job in jobs]
        for _ in concurrent.futures.as_completed(futures):
            done(1.0 / len(jobs))
        return [future.result() for future in futures]

    def close(self) -> None:
        """End the processes at once; what they have not done is not done."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.terminate()


def _guarded(function: Callable[[Any], Any], job: Any) -> Any:
    try:
        return function(job)
    except TwinError as error:
        return Failure(str(error))


def run_benchmark(
    root: Path,
    *,
    workers: int = 1,
    networks: bool = True,
    seed: int = 0,
    only: Sequence[str] = tuple(SECTIONS),
    say: Say = lambda text: None,
    progress: Done = lambda part: None,
) -> list[Row]:
    """Every row that the logs below a folder allow.

    Args:
      root: folders of logs, see `benchmarks.real_logs.source`.
      workers: processes.
      networks: train and judge networks too; without, it takes a third of the time.
      seed: of the simulated missions and of the networks.
      only: names of SECTIONS.
      say: told what is being done.
      progress: told parts of the whole, which add up to 1.

    Raises:
      InputError: no such folder, or no logs in it.
    """
    with (
        tempfile.TemporaryDirectory(prefix="glider-benchmark-") as work,
        closing(Pool(workers)) as pool,
    ):
        deployments, skipped = gather(root, Path(work), say)
        progress(SHARES["import"])
        rows = [
            Row(task="skipped", data=part.name, method="", kind="skipped", note=part.why)
            for part in skipped
        ]
        pretrained = None
        if networks:
            say(f"simulating {surge_networks.HOURS:g} h of missions and training on them")
            stores = surge_networks.simulate(Path(work), seed=seed, workers=workers)
            progress(0.5 * SHARES["simulate"])
            pretrained = _pretrained(stores, seed, pool, progress)
        else:
            progress(SHARES["simulate"])
        shared = Work(
            deployments=deployments, pool=pool, pretrained=pretrained, say=say, progress=progress
        )
        for section, judge in JUDGES.items():
            if section in only:
                rows += judge(shared)
            else:
                progress(SHARES[section])
        # errors name places of this machine: only their folders mean anything to the reader
        rows = [
            dataclasses.replace(
                row,
                note=row.note.replace(f"{work}/", "").replace(f"{root}/", "").replace(".zarr", ""),
            )
            for row in rows
        ]
    order = {name: place for place, name in enumerate(TASKS)}
    return sorted(rows, key=lambda row: order.get(row.task, len(order)))


def failed(task: str, deployment: Deployment, why: str) -> Row:
    """A row that says why there is no figure."""
    return Row(task=task, data=deployment.name, method="", kind="skipped", note=why)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Work:
    """Inputs that the judges of all sections share."""

    deployments: Sequence[Deployment]
    pool: Pool
    pretrained: Pretrained | None
    say: Say
    progress: Done


def _speeds(work: Work) -> list[Row]:
    work.say("speed through the water against a DVL")
    chosen = [d for d in work.deployments if d.kind == "slocum"]
    return _by_folds(
        dvl.TASK,
        dataclasses.replace(work, deployments=chosen),
        jobs_of=lambda deployment: [dvl.DvlJob(deployment, work.pretrained)],
        run=dvl.rows_of,
        rows_of=lambda deployment, found: found[0],
        share=SHARES["speed"],
    )


def _fixes(work: Work) -> list[Row]:
    work.say("depth rate and dead reckoning: the twin identified without the dives that are judged")
    return _by_folds(
        fixes.RATE,
        work,
        jobs_of=fixes.fold_jobs,
        run=fit_fold,
        rows_of=lambda deployment, folds: fixes.rows_of(deployment, folds, work.pretrained),
        share=SHARES["fixes"],
    )


def _surges(work: Work) -> list[Row]:
    work.say("surge against the ADCP, each dive by what was tuned on the others")
    return _by_folds(
        adcp.TASK,
        work,
        jobs_of=lambda deployment: adcp.fold_jobs(deployment, work.pretrained),
        run=adcp.run_fold,
        rows_of=adcp.rows_of,
        share=SHARES["surge"],
    )


def _left_out(work: Work) -> list[Row]:
    work.say("one deployment left out: speed by what was learned on the others")

    def half(part: float) -> None:
        work.progress(0.5 * part * SHARES["left-out"])

    found = work.pool.run(left_out.prepare, work.deployments, half)
    rows = [
        failed(left_out.TASK, deployment, one.why)
        for deployment, one in zip(work.deployments, found, strict=True)
        if isinstance(one, Failure)
    ]
    labelled = [one for one in found if isinstance(one, left_out.Labelled)]
    jobs = left_out.jobs(labelled, work.pretrained)
    if not jobs:
        half(1.0)
        return rows
    judged = work.pool.run(left_out.run, jobs, half)
    for one in judged:
        if isinstance(one, Failure):
            raise TwinError(f"one deployment left out: {one.why}")
    names = [one.name for one in labelled]
    return [*rows, *left_out.rows_of(names, [m for m in judged if not isinstance(m, Failure)])]


JUDGES = {"speed": _speeds, "fixes": _fixes, "surge": _surges, "left-out": _left_out}
"""Judge of each of `SECTIONS`"""


def _by_folds(
    task: str,
    work: Work,
    *,
    jobs_of: Callable[[Deployment], Iterable[Any]],
    run: Callable[[Any], Any],
    rows_of: Callable[[Deployment, list[Any]], list[Row]],
    share: float,
) -> list[Row]:
    """Rows of a task whose folds are run side by side, all deployments' together.

    Args:
      jobs_of: the folds of a deployment; a TwinError says why it has none.
      run: what is done with each, in another process.
      rows_of: rows of a deployment from the results of its folds.
      share: of the whole time.
    """
    rows: list[Row] = []
    jobs: list[tuple[Deployment, Any]] = []
    for deployment in work.deployments:
        try:
            jobs += [(deployment, job) for job in jobs_of(deployment)]
        except TwinError as error:
            rows.append(failed(task, deployment, str(error)))
    results = work.pool.run(run, [job for _, job in jobs], lambda part: work.progress(part * share))
    if not jobs:
        work.progress(share)
    for deployment in work.deployments:
        mine = [r for (d, _), r in zip(jobs, results, strict=True) if d is deployment]
        bad = [r for r in mine if isinstance(r, Failure)]
        good = [r for r in mine if not isinstance(r, Failure)]
        if bad:
            rows.append(failed(task, deployment, bad[0].why))
        elif good:
            rows += rows_of(deployment, good)
    return rows


def _pretrained(stores: Sequence[Path], seed: int, pool: Pool, progress: Done) -> Pretrained:
    found = pool.run(
        surge_networks.simulated_samples,
        [job for store in stores for job in surge_networks.sample_jobs(store)],
        lambda part: progress(0.25 * part * SHARES["simulate"]),
    )
    dives = tuple(d for part in found if not isinstance(part, Failure) for d in part)
    jobs = [
        surge_networks.PretrainJob(dives, kind, member, seed)
        for kind in surge_networks.INPUTS
        for member in range(surge_networks.MEMBERS)
    ]
    trained = pool.run(
        surge_networks.pretrain, jobs, lambda part: progress(0.25 * part * SHARES["simulate"])
    )
    pretrained: Pretrained = {}
    for job, weights in zip(jobs, trained, strict=True):
        if isinstance(weights, Failure):
            raise TwinError(f"training on simulation failed: {weights.why}")
        pretrained.setdefault(job.kind, []).append(weights)
    return pretrained
