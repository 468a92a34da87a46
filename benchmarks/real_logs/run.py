"""Run: all tasks of a folder, with long jobs in parallel processes."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.real_logs import (
    adcp,
    attack,
    dvl,
    fixes,
    left_out,
    propelled,
    propelled_networks,
    propelled_runs,
    surge_networks,
)
from benchmarks.real_logs.row import Row
from benchmarks.real_logs.source import Deployment, gather
from benchmarks.real_logs.surge_networks import Pretrained
from factory.generation.executors import local_pool
from twin.errors import TwinError

Say = Callable[[str], None]
Job = Callable[[], Any]

RATES = (fixes.RATE, fixes.RATE_GLIDING, fixes.RATE_LATER, fixes.RATE_FACTORY)
SECTIONS = {
    "speed": (dvl.TASK,),
    "surge": (adcp.TASK,),
    "left-out": (left_out.TASK, left_out.RATIO),
    "fixes": (*RATES, fixes.TRACK),
    "propelled": propelled.TASKS,
    "attack": attack.TASKS,
}
"""Tasks of each section, which run together; each task is a table"""
TASKS = (*(task for tasks in SECTIONS.values() for task in tasks), "skipped")
"""Tasks in the order of their tables"""


@dataclasses.dataclass(frozen=True)
class Failure:
    """Reason why a job has no result."""

    why: str


def _guarded(job: Job) -> Any:
    try:
        return job()
    except TwinError as error:
        return Failure(str(error))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Work:
    """Inputs of all sections."""

    deployments: Sequence[Deployment]
    each: Callable[..., Iterable[Any]]
    """`map` of this process or of a pool of processes"""
    pretrained: Pretrained | None
    say: Say
    root: Path
    folder: Path
    """Folder of stores and of what a later run need not compute again"""
    networks: bool
    seed: int

    def run(self, jobs: Iterable[Job]) -> list[Any]:
        """Results in the order of the jobs; a `Failure` for each job without a result."""
        return list(self.each(_guarded, jobs))


@contextlib.contextmanager
def mapping(workers: int) -> Iterator[Callable[..., Iterable[Any]]]:
    """Yield the `map` of a pool of processes; a single worker is this process."""
    if workers < 2:
        yield map
        return
    with local_pool(workers, fork=False) as pool:
        yield pool.map


def run_benchmark(
    root: Path,
    *,
    workers: int = 1,
    networks: bool = True,
    seed: int = 0,
    only: Sequence[str] = tuple(SECTIONS),
    place: Path | None = None,
    say: Say = lambda text: None,
) -> list[Row]:
    """Compute every row that the logs below a folder allow.

    Args:
      root: folders of logs, see `benchmarks.real_logs.source`.
      workers: number of processes.
      networks: train and score networks too; without them, a run takes a third of the time.
      seed: seed of the simulated missions and of the networks.
      only: names of SECTIONS.
      place: folder that keeps the propelled section's stores and folds for a later run.
      say: called with a text about each step.

    Raises:
      InputError: no such folder, or no logs in it.
    """
    with (
        tempfile.TemporaryDirectory(prefix="glider-benchmark-") as work,
        mapping(workers) as each,
    ):
        gliders = not set(only) <= {"propelled", "attack"}
        deployments, skipped = gather(root, Path(work), say) if gliders else ([], [])
        rows = [
            Row(task="skipped", data=part.name, method="", kind="skipped", note=part.why)
            for part in skipped
        ]
        shared = Work(
            deployments=deployments, each=each, pretrained=None, say=say, root=root,
            folder=place or Path(work), networks=networks, seed=seed,
        )  # fmt: skip
        if networks and gliders:
            say(f"simulating {surge_networks.HOURS:g} h of missions and training on them")
            stores = surge_networks.simulate(Path(work), seed=seed, workers=workers)
            shared = dataclasses.replace(shared, pretrained=_pretrained(stores, seed, shared))
        for section, judge in JUDGES.items():
            if section in only:
                rows += judge(shared)
        # errors name paths of this machine: a reader needs only the names of their folders
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
    """Make a row with the reason why there is no figure."""
    return Row(task=task, data=deployment.name, method="", kind="skipped", note=why)


def _speeds(work: Work) -> list[Row]:
    work.say("speed through the water against a DVL")
    chosen = [d for d in work.deployments if d.kind == "slocum"]
    return _by_folds(
        dvl.TASK,
        dataclasses.replace(work, deployments=chosen),
        jobs_of=lambda one: [functools.partial(dvl.rows_of, one, work.pretrained)],
        rows_of=lambda deployment, found: found[0],
    )


def _fixes(work: Work) -> list[Row]:
    work.say("depth rate and dead reckoning: the twin identified without the dives that are judged")
    return _by_folds(
        fixes.RATE,
        work,
        jobs_of=fixes.fold_jobs,
        rows_of=lambda deployment, folds: fixes.rows_of(deployment, folds, work.pretrained),
    )


def _surges(work: Work) -> list[Row]:
    work.say("surge against the ADCP, each dive by what was tuned on the others")
    return _by_folds(
        adcp.TASK,
        work,
        jobs_of=lambda deployment: adcp.fold_jobs(deployment, work.pretrained),
        rows_of=adcp.rows_of,
    )


def _left_out(work: Work) -> list[Row]:
    work.say("one deployment left out: speed by what was learned on the others")
    found = work.run(functools.partial(left_out.prepare, one) for one in work.deployments)
    rows = [
        failed(left_out.TASK, deployment, one.why)
        for deployment, one in zip(work.deployments, found, strict=True)
        if isinstance(one, Failure)
    ]
    labelled = [one for one in found if isinstance(one, left_out.Labelled)]
    jobs = left_out.jobs(labelled, work.pretrained)
    if not jobs:
        return rows
    judged = work.run(functools.partial(left_out.run, job) for job in jobs)
    for one in judged:
        if isinstance(one, Failure):
            raise TwinError(f"one deployment left out: {one.why}")
    return [*rows, *left_out.rows_of([one.name for one in labelled], judged)]


def _propelled(work: Work) -> list[Row]:
    vehicles, refused = propelled_runs.gather(work.root)
    work.say(f"propelled vehicles, one run or vehicle left out: {', '.join(vehicles)}")
    pretrained = None
    if work.networks and vehicles:
        work.folder.mkdir(parents=True, exist_ok=True)
        pretrained = propelled_networks.pretrained_on(work.folder, work.seed, work.run)
    jobs = propelled.folds(vehicles, pretrained, work.seed, work.folder)
    answers = work.run(functools.partial(propelled.run, job) for job in jobs)
    for one in answers:
        if isinstance(one, Failure):
            raise TwinError(f"propelled vehicles: {one.why}")
    return [
        *propelled.rows_of(vehicles, jobs, answers),
        *(
            Row(task=propelled.SURGE, data=name, method="", kind="skipped", note=why)
            for name, why in refused.items()
        ),
    ]


def _attacks(work: Work) -> list[Row]:
    work.say("angle of attack by Doppler logs")
    return [row for folder in sorted(work.root.glob("slocum_*")) for row in attack.rows_of(folder)]


JUDGES = {
    "speed": _speeds, "fixes": _fixes, "surge": _surges, "left-out": _left_out,
    "propelled": _propelled, "attack": _attacks,
}  # fmt: skip
"""Function that computes the rows of each section"""


def _by_folds(
    task: str,
    work: Work,
    *,
    jobs_of: Callable[[Deployment], Iterable[Job]],
    rows_of: Callable[[Deployment, list[Any]], list[Row]],
) -> list[Row]:
    """Rows of a task; the folds of all deployments run in parallel.

    Args:
      jobs_of: folds of a deployment, for other processes; a TwinError gives the reason for none.
      rows_of: rows of a deployment from the results of its folds.
    """
    rows: list[Row] = []
    jobs: list[tuple[Deployment, Job]] = []
    for deployment in work.deployments:
        try:
            jobs += [(deployment, job) for job in jobs_of(deployment)]
        except TwinError as error:
            rows.append(failed(task, deployment, str(error)))
    results = work.run(job for _, job in jobs)
    for deployment in work.deployments:
        mine = [r for (d, _), r in zip(jobs, results, strict=True) if d is deployment]
        bad = [r for r in mine if isinstance(r, Failure)]
        if bad:
            rows.append(failed(task, deployment, bad[0].why))
        elif mine:
            rows += rows_of(deployment, mine)
    return rows


def _pretrained(stores: Sequence[Path], seed: int, work: Work) -> Pretrained:
    found = work.run(
        functools.partial(surge_networks.simulated_samples, store, missions)
        for store in stores
        for missions in surge_networks.missions_together(store)
    )
    dives = tuple(d for part in found if not isinstance(part, Failure) for d in part)
    kinds = [(k, m) for k in surge_networks.INPUTS for m in range(surge_networks.MEMBERS)]
    trained = work.run(
        functools.partial(surge_networks.pretrain, dives, kind, member, seed)
        for kind, member in kinds
    )
    pretrained: Pretrained = {}
    for (kind, _), network in zip(kinds, trained, strict=True):
        if isinstance(network, Failure):
            raise TwinError(f"training on simulation failed: {network.why}")
        pretrained.setdefault(kind, []).append(network)
    return pretrained
