"""Fitting: train the networks of a run, the networks of one run or of many side by side."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from learn.data.dataset import load_missions
from learn.data.labels import LabelCounts
from learn.data.logs import SPEED
from learn.data.preparation import training_lengths
from learn.data.several_stores import open_stores
from learn.data.store_checks import check_truth, few_labels, few_missions, labels_in
from learn.run import (
    DESCRIPTION,
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
from learn.training.resources import Resources, choose_residence
from learn.training.trainer import TrainingReport, pick_device
from learn.training.workers import Task, train_tasks
from twin.cli.console import to_json
from twin.cli.endings import interruption
from twin.errors import InputError, WriteError
from twin.navigation.features import channels_of
from twin.navigation.settings import sources
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
"""What a run keeps of its store's description."""
CONTENT = "store_content"
"""Entry of `run.json`: see `twin.records.storage.checksums.content_hash`."""


Watch = Callable[[TrainingJob, TrainingReport], None]
"""Called at every validation of every network."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainingStart:
    """A run that is begun, continued or replaced."""

    config: FitConfig
    folder: Path
    resume: bool = False
    """Continue an unfinished run of the same settings; start it if there is none. With `replace`
    this is one that was begun with `replace`."""
    replace: bool = False
    """Put the new run in the place of an old one once all of it is trained."""


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
    """Train what is missing of one run; arguments as of `Start`, the rest as of `fit_each`."""
    start = TrainingStart(config=config, folder=folder, resume=resume, replace=replace)
    (run,) = fit_each([start], resources, watch=watch, warn=warn, say=say, history=history)
    return run


def fit_each(
    starts: Sequence[TrainingStart],
    resources: Resources,
    *,
    watch: Watch | None = None,
    warn: Callable[[str], None] = lambda _: None,
    say: Callable[[str], None] = lambda _: None,
    history: str = "",
) -> list[Run]:
    """Train what is missing of runs and describe them, the networks of all of them side by side.

    The evaluation is a step of its own. A start that fails, or is interrupted before anything is
    trained, leaves what was there.

    Args:
      watch: sees every validation.
      warn: told what is no error and makes poor networks.
      say: told where the training data are kept.
      history: command line for the record.

    Raises:
      InputError: a folder is in use, or holds a run of other settings or of another store; or the
        memory is too small.
      StoreError: a store cannot be used (see `learn.data.dataset`).
      WriteError: the disk refuses.
    """
    begun = [_begin(start, resources, warn, history) for start in starts]
    waiting = [one for one in begun if one.jobs]
    together = max(1, min(resources.workers, sum(len(one.jobs) for one in waiting)))
    resident = True
    if waiting:
        configs = [one.start.config for one in waiting]
        residence = choose_residence(configs, together, resources.memory)
        resident = residence.resident
        say(residence.told)
    try:
        with contextlib.ExitStack() as stack:
            for one in begun:
                stack.enter_context(one.place)
                repair_metrics(one.folder)
                write_description(one.folder, one.description)
            _train(begun, resources, watch, resident=resident)
            for one in begun:
                one.place.complete()
    except (KeyboardInterrupt, SystemError) as error:
        if interruption(error) is None:
            raise
        raise KeyboardInterrupt(begun[0].place.outcome()) from None
    except OSError as error:
        at = Path(error.filename) if error.filename is not None else begun[0].folder
        for one in begun:
            if at.is_relative_to(one.folder) or one.folder.is_relative_to(at):
                raise WriteError(
                    f"cannot write {one.folder}: {error.strerror or error}; {one.place.outcome()}"
                ) from error
        raise
    return [Run(one.start.folder, one.description) for one in begun]


@dataclasses.dataclass
class _Begun:
    """A run whose sources are checked."""

    start: TrainingStart
    place: RunFolder
    description: dict[str, Any]

    @property
    def folder(self) -> Path:
        """Where it is trained."""
        return self.place.folder

    @functools.cached_property
    def jobs(self) -> list[TrainingJob]:
        """Networks that are not trained yet."""
        return [
            job
            for job in self.start.config.jobs()
            if self.place.fresh or not (self.folder / f"{job.name}.json").is_file()
        ]


def _begin(
    start: TrainingStart, resources: Resources, warn: Callable[[str], None], history: str
) -> _Begun:
    """Check everything before anything is written."""
    config, folder = start.config, start.folder
    if _run_there(folder) is not None and not (start.resume or start.replace):
        raise InputError(f"run {folder} exists; use --resume, --overwrite or another --name")
    training = training_folder(folder, replace=start.replace)
    # beside the run lies only what a fit left: without a description it was being removed
    left = not start.replace or _described(training)
    there = _run_there(training) if start.resume and left else None
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
    place = RunFolder(folder, replace=start.replace, fresh=there is None)
    return _Begun(start, place, description)


def _train(
    begun: Sequence[_Begun], resources: Resources, watch: Watch | None, *, resident: bool
) -> None:
    """Train the networks of all runs; each run is complete when its last one is."""
    owners = {one.folder: one for one in begun}
    left = {one.folder: len(one.jobs) for one in begun}

    def complete(one: _Begun) -> None:
        one.description |= {"complete": True, "finished": now()}
        write_description(one.folder, one.description)

    def finished(task: Task, report: TrainingReport | None) -> None:
        one = owners[task.folder]
        results = {**one.description.get("networks", {}), task.job.name: _figures(task.job, report)}
        one.description["networks"] = results
        left[task.folder] -= 1
        write_description(one.folder, one.description)
        if not left[task.folder]:
            complete(one)

    def seen(task: Task, report: TrainingReport) -> None:
        record = {"network": task.job.name, **dataclasses.asdict(report)}
        with (task.folder / METRICS).open("a") as file:
            file.write(json.dumps(to_json(record)) + "\n")
        if watch is not None:
            watch(task.job, report)

    for one in begun:
        if not one.jobs:
            complete(one)
    tasks = [Task(job, one.folder, resident) for one in begun for job in one.jobs]
    train_tasks(tasks, resources, seen, finished)


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


def _check_sources(config: FitConfig, *, elsewhere: bool) -> tuple[str, ...]:
    """Make sure, before anything is written, that stores, device and start can be used.

    Returns:
      Each store's content, see `twin.records.storage.checksums.content_hash`.
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
        if config.labels.source == "dvl":
            raise InputError(
                "labels of a Doppler log are learned from one store: leave --labels dvl out, or "
                "give the stores one by one"
            )
        with open_stores(config.stores, channels, period=config.period):  # whether they go together
            pass
        for store in config.stores:
            training_lengths(store, config.division, config.period)
    return tuple(content_hash(store, (*sources(channels), SPEED)) for store in config.stores)


def _check_same(
    config: FitConfig, found: Mapping[str, Any], content: Sequence[str], folder: Path
) -> None:
    """Refuse to continue a run under other settings or on other data."""
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
    """The description of a new run."""
    with MissionStore(config.store) as reader:
        attributes = _attributes(reader)
        named = (*(f"true_{t}" for t in TARGETS), SPEED)
        truth = [name for name in named if name in reader.dataset]
    settings, several = to_json(config), {}
    if config.more_stores:
        several[MORE_STORES] = [
            _further(store, one) for store, one in zip(config.more_stores, content[1:], strict=True)
        ]
    else:
        del settings[MORE_STORES]  # versions that know one store alone read such a run
    origins: dict[str, dict[str, Any]] = {}
    if config.start is not None:
        first = open_run(config.start)
        origin = {"run": str(first.folder), "store": ", ".join(map(str, first.stores))}
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


def _further(store: str, content: str) -> dict[str, Any]:
    """What is remembered of a store beside the first."""
    with MissionStore(store) as reader:
        vehicle = reader.vehicle.name
        return {"store": store, "vehicle": vehicle, **_attributes(reader), CONTENT: content}


def _labels(config: FitConfig) -> dict[str, Any]:
    """What the Doppler log gave to learn from, where it was learned from."""
    if config.labels.source == "truth":
        return {}
    counts = labels_in(config.store, config.labels, division=config.division, period=config.period)
    return {LABELS: to_json(dataclasses.asdict(counts))}


def _figures(job: TrainingJob, report: TrainingReport | None) -> dict[str, Any]:
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
