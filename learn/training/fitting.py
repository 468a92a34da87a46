"""Fitting: train the networks of a run, several at a time, and write its `run.json`."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from learn.data.dataset import SPEED, load_missions
from learn.data.labels import LabelCounts
from learn.data.preparation import training_lengths
from learn.data.stores import check_truth, few_labels, few_missions, labels_in, open_stores
from learn.networks.familiarity import MISSIONS, Familiarity, training_flights
from learn.run import (
    DESCRIPTION,
    FAMILIARITY,
    FORMAT,
    LABELS,
    METRICS,
    MORE_STORES,
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
from learn.run_folder import RunFolder, training_folder
from learn.seams import NETWORKS, OPTIMISERS
from learn.training.fit_config import FitConfig, TrainingJob
from learn.training.held_back import HeldMissions, fly_held_back
from learn.training.resources import Resources, choose_residence
from learn.training.trainer import TrainingReport, pick_device
from learn.training.workers import Task, train_tasks
from twin.cli.console import to_json
from twin.cli.program import interruption
from twin.errors import InputError, WriteError
from twin.navigation.features import channels_of
from twin.navigation.flight_filter import HULLS
from twin.navigation.settings import ESTIMATED, sources
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
from twin.records.reader import MissionStore
from twin.records.storage.checksums import content_hash

STORE_ATTRIBUTES = (
    *(PRESET, SEED, HOURS, SENSORS, VEHICLE_SHA256, HISTORY),
    *(SOURCE_FORMAT, PLATFORM, SAMPLE_PERIOD),
)
"""Attributes of the store that `run.json` repeats."""
CONTENT = "store_content"
"""Entry of `run.json`: the store's `twin.records.storage.checksums.content_hash`."""


Watch = Callable[[TrainingJob, TrainingReport], None]
"""Function called at every validation of every network."""


IN_THIS_PROCESS = Resources()


def fit(
    config: FitConfig,
    folder: Path,
    resources: Resources = IN_THIS_PROCESS,
    *,
    resume: bool = False,
    replace: bool = False,
    watch: Watch | None = None,
    warn: Callable[[str], None] = lambda _: None,
    say: Callable[[str], None] = lambda _: None,
    history: str = "",
) -> Run:
    """Train the missing networks of a run, several at a time, and write its `run.json`.

    The evaluation is a separate step (`learn.finishing`). If a fit fails or is interrupted before
    its first checkpoint, the folder stays as it was.

    Args:
      resume: continue an unfinished run of the same settings; start it if there is none. With
        `replace`, continue an interrupted replacement.
      replace: replace an old run once all networks are trained.
      watch: called at every validation.
      warn: called with warnings on settings or data that make poor networks.
      say: called with a sentence on the place of the training data.
      history: command line for the record.

    Raises:
      InputError: the folder is in use, or holds a run of other settings or of another store; or the
        memory is too small.
      StoreError: a store cannot be used (see `learn.data.dataset`).
      WriteError: the disk refuses.
    """
    there = _run_to_continue(folder, resume=resume, replace=replace)
    description = _checked(config, folder, there, resources, warn, history)
    place = RunFolder(folder, replace=replace, fresh=there is None)
    jobs = [
        job
        for job in config.jobs()
        if place.fresh or not (place.folder / f"{job.name}.json").is_file()
    ]
    resident = True
    if jobs:
        together = max(1, min(resources.workers, len(jobs)))
        residence = choose_residence(config, together, resources.memory)
        resident = residence.resident
        say(residence.told)
    try:
        with place:
            repair_metrics(place.folder)
            write_description(place.folder, description)
            stores = fly_held_back(config, place.folder, say) if jobs else ()
            held: dict[str, Path] = {}
            if stores:
                missions = HeldMissions(config, stores, fresh=place.fresh)
                if place.fresh:
                    config = dataclasses.replace(config, hulls=missions.choose_hulls(say))
                    description["settings"]["hulls"] = config.hulls
                    write_description(place.folder, description)
                    jobs = config.jobs()
                for job in jobs:
                    held[job.name] = place.folder / f"held-back-{job.name}.npz"
                    missions.rows(job.name, config.hulls).save(held[job.name])
                del missions  # frees its memory before the training
                if set(channels_of(config.features)) & set(ESTIMATED):
                    known = training_flights(
                        (*config.stores, *stores), config.period, HULLS[config.hulls], MISSIONS
                    )
                    description[FAMILIARITY] = to_json(Familiarity.fit(known))
            tasks = [Task(job, place.folder, resident, held.get(job.name)) for job in jobs]
            _train(tasks, place.folder, description, resources, watch)
            for one in stores:
                shutil.rmtree(one)
                Path(f"{one}.log").unlink(missing_ok=True)
            for file in place.folder.glob("held-back-*.npz"):
                file.unlink()
            description |= {"complete": True, "finished": now()}
            write_description(place.folder, description)
            place.complete()
    except (KeyboardInterrupt, SystemError) as error:
        if interruption(error) is None:
            raise
        raise KeyboardInterrupt(place.outcome()) from None
    except OSError as error:
        at = Path(error.filename) if error.filename is not None else place.folder
        if at.is_relative_to(place.folder) or place.folder.is_relative_to(at):
            raise WriteError(
                f"cannot write {place.folder}: {error.strerror or error}; {place.outcome()}"
            ) from error
        raise
    return Run(folder, description)


def _train(
    tasks: Sequence[Task],
    folder: Path,
    description: dict[str, Any],
    resources: Resources,
    watch: Watch | None,
) -> None:
    """Train networks in a folder; each saved network adds its numbers to the description."""

    def finished(task: Task, report: TrainingReport | None) -> None:
        results = {**description.get("networks", {}), task.job.name: _figures(task.job, report)}
        description["networks"] = results
        write_description(folder, description)

    def seen(task: Task, report: TrainingReport) -> None:
        record = {"network": task.job.name, **dataclasses.asdict(report)}
        with (folder / METRICS).open("a") as file:
            file.write(json.dumps(to_json(record)) + "\n")
        if watch is not None:
            watch(task.job, report)

    train_tasks(tasks, resources, seen, finished)


def _run_to_continue(folder: Path, *, resume: bool, replace: bool) -> dict[str, Any] | None:
    """Description of the run to continue; None starts a new run."""
    if _run_there(folder) is not None and not (resume or replace):
        raise InputError(f"run {folder} exists; use --resume, --overwrite or another --name")
    training = training_folder(folder, replace=replace)
    # a replacement's folder without a description was only half removed: start anew
    left = not replace or _described(training)
    return _run_there(training) if resume and left else None


def _checked(
    config: FitConfig,
    folder: Path,
    there: dict[str, Any] | None,
    resources: Resources,
    warn: Callable[[str], None],
    history: str,
) -> dict[str, Any]:
    """Check stores, settings and folder; returns the description of the run."""
    content = _check_sources(config, elsewhere=resources.executor is not None)
    for store in config.stores:
        if text := few_missions(store, config.division):
            warn(text)
    if there is not None:
        _check_same(config, there, content, folder)
    description = _describe(config, content, history) if there is None else there
    if LABELS in description and (
        text := few_labels(config.store, config.labels, LabelCounts(**description[LABELS]))
    ):
        warn(text)
    return description


def _run_there(folder: Path) -> dict[str, Any] | None:
    """Description of the run in a folder; None if the folder is missing or empty.

    Raises:
      InputError: the folder holds something other than a run.
    """
    if not folder.exists():
        return None
    if not folder.is_dir() or (any(folder.iterdir()) and not _described(folder)):
        raise InputError(f"{folder} is in the way and is not a run; choose another --name")
    return read_description(folder) if _described(folder) else None


def _described(folder: Path) -> bool:
    return (folder / DESCRIPTION).is_file()


def _check_sources(config: FitConfig, *, elsewhere: bool) -> tuple[str, ...]:
    """Check stores, device and start, before any file is written.

    Returns:
      Content hash of each store, see `twin.records.storage.checksums.content_hash`.
    """
    pick_device(config.training.device)
    if elsewhere:
        NETWORKS.check_importable(config.network.kind)
        OPTIMISERS.check_importable(config.training.optimiser)
    if config.start is not None:
        for ensemble in open_run(config.start).networks().values():
            if ensemble.members[0].features != config.features:
                raise InputError(f"run {config.start} has other inputs; leave them to --start")
    if config.labels.source == "truth":
        check_truth(config.store)
    channels = (*channels_of(config.features), *config.labels.channels())
    for store in config.stores:
        load_missions(store, channels, limit=1, period=config.period)
    if config.more_stores:
        if config.labels.source != "truth":
            raise InputError(
                f"labels of a {config.labels.device} are learned from one store: leave --labels "
                f"{config.labels.source} out, or give the stores one by one"
            )
        with open_stores(config.stores, channels, period=config.period):  # raises if incompatible
            pass
        for store in config.stores:
            training_lengths(store, config.division, config.period)
    return tuple(content_hash(store, (*sources(channels), SPEED)) for store in config.stores)


def _check_same(
    config: FitConfig, found: Mapping[str, Any], content: Sequence[str], folder: Path
) -> None:
    """Refuse to continue a run with other settings or other data."""
    if changes := FitConfig.of(found["settings"], folder).differences(config):
        raise InputError(
            f"run {folder} was started with {'; '.join(changes)}: leave these options out to go on "
            "with it, or choose another --name"
        )
    kept = [found, *found.get(MORE_STORES, ())]
    for store, now_there, before in zip(config.stores, content, kept, strict=True):
        if before.get(CONTENT, now_there) != now_there:
            raise InputError(
                f"store {store} is not the one that run {folder} was started on, its missions "
                "differ: bring that one back, or start over with --overwrite"
            )


def _describe(config: FitConfig, content: Sequence[str], history: str) -> dict[str, Any]:
    """Description of a new run, the content of its `run.json`."""
    with MissionStore(config.store) as reader:
        attributes = _attributes(reader)
        named = (*(f"true_{t}" for t in TARGETS), SPEED)
        truth = [name for name in named if name in reader.dataset]
    settings, several = to_json(config), {}
    if config.more_stores:
        several[MORE_STORES] = [
            _entry(store, one) for store, one in zip(config.more_stores, content[1:], strict=True)
        ]
    else:
        del settings[MORE_STORES]  # so that older versions, which know a single store, read the run
    origins: dict[str, dict[str, Any]] = {}
    if config.start is not None:
        first = open_run(config.start)
        stores = () if first.shipped else first.stores
        origin = {"run": str(first.folder), "store": ", ".join(map(str, stores))}
        origins[ORIGIN] = {**first.description["store"], **origin}
        if earlier := first.description.get(ORIGIN):
            origins[ORIGIN][ORIGIN] = earlier
    return {
        "format": FORMAT,
        "created": now(),
        "complete": False,
        "history": history,
        "settings": settings,
        "store": attributes,
        **several,
        TRUTH: truth,
        **_labels(config),
        **origins,
        CONTENT: content[0],
        "versions": versions(),
    }


def _attributes(reader: MissionStore) -> dict[str, Any]:
    return {k: v for k in STORE_ATTRIBUTES if (v := reader.attributes.get(k)) is not None}


def _entry(store: str, content: str) -> dict[str, Any]:
    """Entry of `run.json` for a store after the first."""
    with MissionStore(store) as reader:
        vehicle = reader.vehicle.name
        return {"store": store, "vehicle": vehicle, **_attributes(reader), CONTENT: content}


def _labels(config: FitConfig) -> dict[str, Any]:
    """Entry of `run.json` with the Doppler log's label counts; empty if the truth was learned."""
    if config.labels.source == "truth":
        return {}
    counts = labels_in(config.store, config.labels, division=config.division, period=config.period)
    return {LABELS: to_json(dataclasses.asdict(counts))}


def _figures(job: TrainingJob, report: TrainingReport | None) -> dict[str, Any]:
    """Numbers of a network's training for `run.json`."""
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
