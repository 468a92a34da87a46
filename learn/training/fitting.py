"""Fitting: train the networks of a run, side by side in processes of one thread each."""

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
from learn.data.labels import LabelCounts
from learn.data.logs import SPEED
from learn.data.preparation import check_truth, few_labels, few_missions, labels_in
from learn.networks.registry import NETWORKS
from learn.runs.place import Place, training_folder
from learn.runs.run import (
    DESCRIPTION,
    FORMAT,
    LABELS,
    METRICS,
    ORIGIN,
    TARGETS,
    TRUTH,
    Run,
    now,
    open_run,
    read_description,
    repair_metrics,
    versions,
    write_description,
)
from learn.training.job import train
from learn.training.optimisers.registry import OPTIMISERS
from learn.training.settings import FitConfig, Job
from learn.training.trainer import Report, pick_device
from learn.training.workers import train_in_workers
from twin.cli.console import to_json
from twin.errors import InputError, WriteError
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
    warn: Callable[[str], None] = lambda _: None,
    history: str = "",
) -> Run:
    """Train what is missing in `folder` and describe it; the evaluation is a step of its own.

    A start that fails, or is interrupted before anything is trained, leaves what was there.

    Args:
      resume: continue an unfinished run of the same settings; start it if there is none. With
        `replace` this is one that was begun with `replace`.
      replace: put the new run in the place of an old one once all of it is trained.
      workers: processes; 1 trains in this one.
      watch: sees every validation.
      warn: told what is no error and makes poor networks.
      history: command line for the record.

    Raises:
      InputError: the folder is in use, or holds a run of other settings or of another store.
      StoreError: the store cannot be used (see `learn.data.dataset`).
      WriteError: the disk refuses.
    """
    if workers < 1:
        raise InputError(f"workers must be at least 1, not {workers}")
    if _run_there(folder) is not None and not (resume or replace):
        raise InputError(f"run {folder} exists; use --resume, --overwrite or another --name")
    training = training_folder(folder, replace=replace)
    # beside the run lies only what a fit left: without a description it was being removed
    there = _run_there(training) if resume and (not replace or _described(training)) else None
    content = _check_sources(config, workers)
    if text := few_missions(config.store, config.division):
        warn(text)
    if there is not None:
        _check_same(config, there, content, folder)
    description = _describe(config, content, history) if there is None else there
    if LABELS in description and (
        text := few_labels(config.store, config.labels, LabelCounts(**description[LABELS]))
    ):
        warn(text)
    place = Place(folder, replace=replace, fresh=there is None)
    try:
        with place:
            repair_metrics(place.folder)
            write_description(place.folder, description)
            run = _train_all(config, place.folder, description, workers=workers, watch=watch)
            place.complete()
    except KeyboardInterrupt:
        raise KeyboardInterrupt(place.outcome()) from None
    except OSError as error:
        where = Path(error.filename or place.folder)
        if not (where.is_relative_to(place.folder) or place.folder.is_relative_to(where)):
            raise  # from reading something else
        raise WriteError(
            f"cannot write {place.folder}: {error.strerror or error}; {place.outcome()}"
        ) from error
    return Run(folder, run.description)


def _train_all(
    config: FitConfig,
    folder: Path,
    description: dict[str, Any],
    *,
    workers: int,
    watch: Watch | None,
) -> Run:
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
        train_in_workers(jobs, folder, min(workers, len(jobs)), seen, finished)
    description = {**description, "networks": results, "complete": True, "finished": now()}
    write_description(folder, description)
    return Run(folder, description)


def _run_there(folder: Path) -> dict[str, Any] | None:
    """The description of the run in a folder, None where there is nothing.

    Raises:
      InputError: something else is there.
    """
    if not folder.exists():
        return None
    if not folder.is_dir() or (any(folder.iterdir()) and not _described(folder)):
        raise InputError(f"{folder} is in the way and is not a run; choose another --name")
    return read_description(folder) if _described(folder) else None


def _described(folder: Path) -> bool:
    return (folder / DESCRIPTION).is_file()


def _check_sources(config: FitConfig, workers: int) -> str:
    """Make sure, before anything is written, that store, device and start can be used.

    Returns:
      The store's content, see `twin.records.content.content_hash`.
    """
    pick_device(config.training.device)
    if workers > 1:
        NETWORKS.check_importable(config.network.kind)
        OPTIMISERS.check_importable(config.training.optimiser)
    if config.start is not None:
        for ensemble in open_run(config.start).networks().values():
            if ensemble.members[0].features != config.features:
                raise InputError(f"run {config.start} has other inputs; leave them to --start")
    if config.labels.source == "truth":
        check_truth(config.store)
    channels = (*channels_of(config.features), *config.labels.channels())
    load_missions(config.store, channels, limit=1, period=config.period)
    return content_hash(config.store, (*channels, SPEED))


def _check_same(config: FitConfig, found: Mapping[str, Any], content: str, folder: Path) -> None:
    """Refuse to continue a run under other settings or on other data."""
    if changes := FitConfig.of(found["settings"], folder).differences(config):
        raise InputError(
            f"run {folder} was started with {'; '.join(changes)}: leave these options out to go on "
            "with it, or choose another --name"
        )
    if found.get(CONTENT, content) != content:
        raise InputError(
            f"store {config.store} is not the one that run {folder} was started on, its missions "
            "differ: bring that one back, or start over with --overwrite"
        )


def _describe(config: FitConfig, content: str, history: str) -> dict[str, Any]:
    """The description of a new run."""
    with MissionStore(config.store) as reader:
        attributes = {k: v for k in STORE_ATTRIBUTES if (v := reader.attributes.get(k)) is not None}
        named = (*(f"true_{t}" for t in TARGETS), SPEED)
        truth = [name for name in named if name in reader.dataset]
    origins: dict[str, dict[str, Any]] = {}
    if config.start is not None:
        first = open_run(config.start)
        origin = {"run": str(first.folder), "store": str(first.store)}
        origins[ORIGIN] = {**first.description["store"], **origin}
        if earlier := first.description.get(ORIGIN):
            origins[ORIGIN][ORIGIN] = earlier
    return {
        "format": FORMAT,
        "created": now(),
        "complete": False,
        "history": history,
        "settings": to_json(config),
        "store": attributes,
        TRUTH: truth,
        **_labels(config),
        **origins,
        CONTENT: content,
        "versions": versions(),
    }


def _labels(config: FitConfig) -> dict[str, Any]:
    """What the Doppler log gave to learn from, where it was learned from."""
    if config.labels.source == "truth":
        return {}
    counts = labels_in(config.store, config.labels, division=config.division, period=config.period)
    return {LABELS: to_json(dataclasses.asdict(counts))}


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
