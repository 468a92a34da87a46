"""Fit: train the networks of a run, side by side in processes of one thread each."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from learn.data.dataset import load_missions
from learn.data.features import channels_of
from learn.data.logs import SPEED
from learn.data.preparation import Division, check_truth, prepare
from learn.networks.network import NetworkConfig
from learn.runs.claim import CHECKPOINT, Claim, recover
from learn.runs.run import (
    DESCRIPTION,
    FORMAT,
    METRICS,
    TARGETS,
    Run,
    now,
    open_run,
    read_description,
    repair_metrics,
    stem,
    versions,
    write_description,
)
from learn.training.loop import Report, Trainer, pick_device
from learn.training.schedule import TrainingConfig
from learn.training.trainers import train_aside
from twin.cli.console import to_json
from twin.errors import InputError, StoreError
from twin.records.attributes import (
    HISTORY,
    HOURS,
    PLATFORM,
    PRESET,
    SAMPLE_PERIOD,
    SEED,
    SENSORS,
    SOURCE_FORMAT,
    VEHICLE_SHA256,
)
from twin.records.content import content_hash
from twin.records.reader import MissionStore

STORE_ATTRIBUTES = (
    *(PRESET, SEED, HOURS, SENSORS, VEHICLE_SHA256, HISTORY),
    *(SOURCE_FORMAT, PLATFORM, SAMPLE_PERIOD),
)
"""What a run keeps of its store's description."""
CONTENT = "store_content"
"""Entry of `run.json`: see `twin.records.content.content_hash`."""
FREE = ("device", "threads")
"""Settings of a training with which another machine may go on."""


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
    """Rows of the store that are not trained on, see `learn.data.preparation.prepare`."""

    def __post_init__(self) -> None:
        if self.members < 1:
            raise InputError(f"members must be at least 1, not {self.members}")
        if self.period is not None and not (math.isfinite(self.period) and self.period > 0.0):
            raise InputError(f"period must be a finite number of seconds above 0: {self.period}")
        if not self.features:
            raise InputError("the networks need at least one input feature")

    @classmethod
    def of(cls, settings: Mapping[str, Any], folder: Path) -> FitConfig:
        """From a run's stored settings; those of a later version than the run are the defaults.

        Raises:
          StoreError: they are damaged, or of a later version.
        """
        values = dict(settings)
        try:
            values["network"] = NetworkConfig(**values["network"])
            values["training"] = TrainingConfig(**values["training"])
            for name in ("features", "held_out"):
                values[name] = tuple(values.get(name, ()))
            return cls(**values)
        except (TypeError, KeyError) as error:
            raise StoreError(
                f"{folder / DESCRIPTION} has settings that this version does not know ({error})"
            ) from error

    def differences(self, other: FitConfig) -> list[str]:
        """What `other` has otherwise, setting by setting, without those that may change."""
        ours, theirs = (dataclasses.asdict(config) for config in (self, other))
        for part in ("network", "training"):
            for values in (ours, theirs):
                values |= {k: v for k, v in values.pop(part).items() if k not in FREE}
        found = []
        for name, mine in ours.items():
            if mine == theirs[name]:
                continue
            if isinstance(mine, tuple):
                gone = [str(v) for v in mine if v not in theirs[name]]
                new = [str(v) for v in theirs[name] if v not in mine]
                parts = [f"with {', '.join(gone)}"] * bool(gone)
                parts += [f"without {', '.join(new)}"] * bool(new)
                found.append(f"{name} {' and '.join(parts) or 'in another order'}")
            else:
                found.append(f"{name} {mine} instead of {theirs[name]}")
        return found

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
    replace: bool = False,
    workers: int = 2,
    watch: Watch | None = None,
    history: str = "",
) -> Run:
    """Train what is missing in `folder` and describe it; the evaluation is a step of its own.

    A start that fails, or is interrupted before anything is trained, leaves what was there.

    Args:
      resume: go on with an unfinished run of the same settings; start it if there is none.
      replace: put the new run in the place of an old one.
      workers: processes; 1 trains in this one.
      watch: sees every validation.
      history: command line for the record.

    Raises:
      InputError: the folder is in use, or holds a run of other settings or of another store.
      StoreError: the store cannot be used (see `learn.data.dataset`).
    """
    if workers < 1:
        raise InputError(f"workers must be at least 1, not {workers}")
    if resume and replace:
        raise InputError(
            "a run is either gone on with or replaced: leave out --resume or --overwrite"
        )
    recover(folder)
    there = _run_there(folder)
    if there is not None and not (resume or replace):
        raise InputError(f"run {folder} exists; use --resume, --overwrite or another --name")
    content = _check_sources(config)
    going_on = there is not None and resume
    if there is not None and resume:
        _check_same(config, there, content, folder)
        description = there
    else:
        description = _describe(config, content, history)
    claim = Claim(folder, new=not going_on)
    try:
        with claim:
            if going_on:
                repair_metrics(folder)
            write_description(folder, description)
            return _train_all(config, claim, description, workers=workers, watch=watch)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(claim.outcome()) from None


def _train_all(
    config: FitConfig,
    claim: Claim,
    description: dict[str, Any],
    *,
    workers: int,
    watch: Watch | None,
) -> Run:
    folder = claim.folder
    jobs = [job for job in config.jobs() if not (folder / f"{job.name}.json").is_file()]
    results = dict(description.get("networks", {}))

    def finished(job: Job, report: Report | None) -> None:
        claim.settle()
        results[job.name] = _figures(job, report)
        write_description(folder, {**description, "networks": results})

    def seen(job: Job, report: Report) -> None:
        claim.settle()
        record = {"network": job.name, **dataclasses.asdict(report)}
        with (folder / METRICS).open("a") as file:
            file.write(json.dumps(to_json(record)) + "\n")
        if watch is not None:
            watch(job, report)

    if workers == 1 or len(jobs) < 2:
        for job in jobs:
            finished(job, train(job, folder, functools.partial(seen, job)))
    else:
        train_aside(jobs, folder, min(workers, len(jobs)), seen, finished)
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
    from learn.networks.predictor import Predictor

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


def _run_there(folder: Path) -> dict[str, Any] | None:
    """The description of the run in a folder, None where there is nothing.

    Raises:
      InputError: something else is there.
    """
    if not folder.exists():
        return None
    if not folder.is_dir() or (any(folder.iterdir()) and not (folder / DESCRIPTION).is_file()):
        raise InputError(f"{folder} is in the way and is not a run; choose another --name")
    return read_description(folder) if (folder / DESCRIPTION).is_file() else None


def _check_sources(config: FitConfig) -> str:
    """Make sure, before anything is written, that store, device and start can be used.

    Returns:
      The store's content, see `twin.records.content.content_hash`.
    """
    pick_device(config.training.device)
    if config.start is not None:
        for ensemble in open_run(config.start).networks().values():
            if ensemble.members[0].features != config.features:
                raise InputError(f"run {config.start} has other inputs; leave them to --start")
    check_truth(config.store)
    channels = (*channels_of(config.features), *(f"true_{name}" for name in TARGETS))
    load_missions(config.store, channels, limit=1, period=config.period)
    return content_hash(config.store, (*channels, SPEED))


def _check_same(config: FitConfig, found: Mapping[str, Any], content: str, folder: Path) -> None:
    """Refuse to go on with a run under other settings or on other data."""
    if changes := FitConfig.of(found["settings"], folder).differences(config):
        raise InputError(
            f"run {folder} was started with {'; '.join(changes)}: leave these options out to go on "
            "with it, or choose another --name"
        )
    if found.get(CONTENT, content) != content:
        raise InputError(
            f"store {config.store} is not the one that run {folder} was started on, its missions "
            "differ: bring that one back, or start anew with --overwrite"
        )


def _describe(config: FitConfig, content: str, history: str) -> dict[str, Any]:
    """The description of a new run."""
    with MissionStore(config.store) as reader:
        attributes = {k: v for k in STORE_ATTRIBUTES if (v := reader.attributes.get(k)) is not None}
    return {
        "format": FORMAT,
        "created": now(),
        "complete": False,
        "history": history,
        "settings": to_json(config),
        "store": attributes,
        CONTENT: content,
        "versions": versions(),
    }


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
