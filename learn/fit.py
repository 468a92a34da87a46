"""Fit: train the networks of a run, side by side in processes of one thread each."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import multiprocessing
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from learn.networks import NetworkConfig
from learn.preparation import Division, prepare
from learn.run import (
    DESCRIPTION,
    FORMAT,
    METRICS,
    TARGETS,
    Run,
    now,
    open_run,
    read_description,
    stem,
    versions,
    write_description,
)
from learn.schedule import TrainingConfig
from learn.training import Report, Trainer
from twin.console import to_json
from twin.errors import InputError, TwinError
from twin.store import open_store

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

CHECKPOINT = ".checkpoint"
STORE_ATTRIBUTES = (
    *("preset", "seed", "hours", "sensors", "vehicle_sha256", "history"),
    *("source_format", "platform", "sample_period_s"),
)
"""What a run keeps of its store's description."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FitConfig:
    """Everything that decides what a run becomes."""

    store: str
    """Path of the store."""
    features: tuple[str, ...]
    """Inputs by name, in order."""
    network: NetworkConfig = dataclasses.field(default_factory=NetworkConfig)
    training: TrainingConfig = dataclasses.field(default_factory=TrainingConfig)
    """Its seed is the first member's of surge; every network gets one of its own."""
    members: int = 1
    """Networks per velocity; their spread is an uncertainty."""
    division: Division = "missions"
    """`missions`: the store's split. `samples`: the paper's random 70/15/15, which leaks."""
    mirror: bool = True
    """Whether the training shows every mission mirrored, port for starboard, too."""
    period: float | None = None
    """[s] between samples, a multiple of the store's; None takes all of them."""
    start: str | None = None
    """Run whose weights and scales the training goes on from; None starts at random."""
    held_out: tuple[int, ...] = ()
    """Rows of the store that are not trained on, see `learn.preparation.prepare`."""

    def __post_init__(self) -> None:
        if self.members < 1:
            raise InputError(f"members must be at least 1, not {self.members}")
        if not self.features:
            raise InputError("the networks need at least one input feature")

    def jobs(self) -> list[Job]:
        """The networks to train."""
        return [
            Job(
                target=target,
                member=member,
                config=self,
                seed=self.training.seed + member * len(TARGETS) + place,
            )
            for member in range(self.members)
            for place, target in enumerate(TARGETS)
        ]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Job:
    """One network of a run."""

    target: str
    member: int
    config: FitConfig
    seed: int

    @property
    def name(self) -> str:
        """Name of its files."""
        return f"{self.target}-{self.member}"


Watch = Callable[[Job, Report], None]
"""Called at every validation of every network."""


def fit(
    config: FitConfig,
    folder: Path,
    *,
    resume: bool = False,
    workers: int = 2,
    watch: Watch | None = None,
    history: str = "",
) -> Run:
    """Train what is missing in `folder` and describe it; the evaluation is a step of its own.

    Args:
      resume: go on with an unfinished run of the same settings; start it if there is none.
      workers: processes; 1 trains in this one.
      watch: sees every validation.
      history: command line for the record.

    Raises:
      InputError: the folder is in use, or holds a run of other settings.
      StoreError: the store cannot be used (see `learn.dataset`).
    """
    description = _begin(config, folder, resume=resume, history=history)
    jobs = [job for job in config.jobs() if not (folder / f"{job.name}.json").is_file()]
    results = dict(description.get("networks", {}))

    def finished(job: Job, report: Report | None) -> None:
        results[job.name] = _figures(job, report)
        write_description(folder, {**description, "networks": results})

    def seen(job: Job, report: Report) -> None:
        record = {"network": job.name, **dataclasses.asdict(report)}
        with (folder / METRICS).open("a") as file:
            file.write(json.dumps(to_json(record)) + "\n")
        if watch is not None:
            watch(job, report)

    if workers == 1 or len(jobs) < 2:
        for job in jobs:
            finished(job, train(job, folder, functools.partial(seen, job)))
    else:
        _train_aside(jobs, folder, min(workers, len(jobs)), seen, finished)
    description = {**description, "networks": results, "complete": True, "finished": now()}
    write_description(folder, description)
    return Run(folder, description)


def train(job: Job, folder: Path, report: Callable[[Report], None]) -> Report | None:
    """Train one network and save it; its last report, None when nothing was left to do."""
    config = job.config
    start = None
    if config.start is not None:
        members = open_run(config.start).networks()[job.target].members
        start = members[job.member % len(members)]
        if start.features != config.features:
            raise InputError(f"run {config.start} has other inputs; leave the inputs to --start")
    data = prepare(
        config.store,
        target=job.target,
        features=config.features,
        division=config.division,
        seed=config.training.seed,
        mirror=config.mirror,
        period=config.period,
        scales=None if start is None else start.normalisation,
        held_out=config.held_out,
    )
    from learn.predictor import Predictor

    trained = Trainer(
        config.network,
        dataclasses.replace(config.training, seed=job.seed),
        data.train,
        data.validation,
        target_scale=data.normalisation.target_scale,
        checkpoint=folder / f"{job.name}{CHECKPOINT}",
        report=report,
        start=None if start is None else start.network.state_dict(),
    ).run()
    Predictor(trained.network.cpu(), data.normalisation).save(stem(folder, job.target, job.member))
    return trained.history[-1] if trained.history else None


def _begin(config: FitConfig, folder: Path, *, resume: bool, history: str) -> dict[str, Any]:
    """The description of a new run, or that of the one to go on with."""
    settings = to_json(config)
    if folder.exists() and any(folder.iterdir()):
        if not (folder / DESCRIPTION).is_file():
            raise InputError(f"{folder} is in the way and is not a run; choose another --name")
        if not resume:
            raise InputError(f"run {folder} exists; use --resume, --overwrite or another --name")
        found = read_description(folder)
        for name, value in settings.items():
            if found["settings"].get(name) != value:
                raise InputError(
                    f"run {folder} was started with {name} {found['settings'].get(name)}, not "
                    f"{value}; give the same settings or another --name"
                )
        return found
    dataset = open_store(config.store)
    attributes = {k: dataset.attrs[k] for k in STORE_ATTRIBUTES if k in dataset.attrs}
    dataset.close()
    folder.mkdir(parents=True, exist_ok=True)
    description = {
        "format": FORMAT,
        "created": now(),
        "complete": False,
        "history": history,
        "settings": settings,
        "store": attributes,
        "versions": versions(),
    }
    write_description(folder, description)
    return description


def _figures(job: Job, report: Report | None) -> dict[str, Any]:
    """What is remembered of a training."""
    if report is None:
        return {"seed": job.seed}
    return {
        "seed": job.seed,
        "train_mse": report.train_mse,
        "validation_mse": None if math.isnan(report.validation_mse) else report.best_mse,
        "steps": report.step,
        "epochs": report.epoch,
        "seconds": report.seconds,
    }


@dataclasses.dataclass(frozen=True)
class _Worker:
    """A process that trains one network, and the end of the pipe on which it tells of it."""

    job: Job
    process: BaseProcess
    messages: Connection


def _train_aside(
    jobs: Sequence[Job],
    folder: Path,
    workers: int,
    seen: Watch,
    finished: Callable[[Job, Report | None], None],
) -> None:
    """Train in processes; an interrupt or an error ends them, their checkpoints stay."""
    waiting = list(jobs)
    running: dict[Connection, _Worker] = {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                worker = _start(waiting.pop(0), folder)
                running[worker.messages] = worker
            for end in wait(list(running)):
                worker = running[end]  # type: ignore[index]
                try:
                    kind, content = worker.messages.recv()
                except EOFError:
                    kind, content = "error", _death(worker)
                if kind == "report":
                    seen(worker.job, content)
                elif kind == "done":
                    worker.process.join()
                    del running[worker.messages]
                    finished(worker.job, content)
                else:
                    raise content
    finally:
        for worker in running.values():
            worker.process.terminate()
            worker.process.join()
            worker.messages.close()


def _start(job: Job, folder: Path) -> _Worker:
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(job, folder, sender), daemon=True, name=job.name)
    process.start()
    sender.close()  # so that the process's death shows as the end of the messages
    return _Worker(job, process, receiver)


def _work(job: Job, folder: Path, messages: Connection) -> None:
    """One process: reports and the result go through the pipe."""
    import signal
    import sys

    # An interrupt is for the parent, which ends this process; it then leaves in good order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    try:
        last = train(job, folder, lambda report: messages.send(("report", report)))
    except TwinError as error:
        messages.send(("error", type(error)(*error.args)))
    except Exception as error:  # carried to the parent, which alone may speak to the user
        text = f"training of {job.name} failed: {type(error).__name__}: {error}"
        messages.send(("error", TwinError(text)))
    else:
        messages.send(("done", last))


def _death(worker: _Worker) -> TwinError:
    worker.process.join()
    return TwinError(
        f"the process that trains {worker.job.name} ended with code {worker.process.exitcode} "
        "(out of memory?); go on with `learn fit --resume`"
    )
