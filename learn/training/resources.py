"""Resources: the processes that train networks side by side, and the memory for their data.

A job trains and saves one network of a run. Its process ends with the one that started it, however
that one ends. The training data stay in memory where there is room, and are streamed otherwise.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from learn.data.dataset import AT_A_TIME
from learn.data.preparation import prepare, sample_bytes, training_lengths
from learn.networks.predictor import Predictor, groups_by_length
from learn.run import open_run, stem
from learn.run_folder import CHECKPOINT
from learn.training.feed import recalled_columns
from learn.training.fit_config import FitConfig, TrainingJob
from learn.training.trainer import Trainer, TrainingReport
from twin.errors import InputError
from twin.navigation.flight_filter import HULLS
from twin.numbers import processors
from twin.records.windows import buffers

CHECK_S = 1.0
"""[s] between looks whether the parent lives."""


def end_with(parent: int) -> None:
    """In a process that `parent` started: end within about CHECK_S after it, even after a kill.

    An interrupt at the keyboard reaches all processes at once: it is the parent's to answer.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(CHECK_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


GB = 1e9
SHARE = 0.5
"""Of the memory that is free: the rest is for the programs, their libraries and what else runs"""
READING = 400
"""Bytes of a sample while its channels become features"""
CGROUPS = Path("/sys/fs/cgroup")


@dataclasses.dataclass(frozen=True)
class Residence:
    """Where the training data are."""

    resident: bool
    """In memory; else they are read from the store whenever they are needed"""
    told: str
    """The choice and its reason in one line"""


def choose_residence(config: FitConfig, together: int, memory: float | None = None) -> Residence:
    """Decide for networks of which `together` are trained at a time.

    Args:
      memory: [GB] for the training data of all of them; None: half of what this machine has free.

    Raises:
      InputError: not even the buffers fit.
      StoreError: a store cannot be opened.
    """
    if memory is not None and not (np.isfinite(memory) and memory > 0.0):
        raise InputError(f"--memory {memory:g} must be a number of GB above 0")
    allowed = free_memory() * SHARE if memory is None else memory * GB
    whole, streamed = (together * size for size in _sizes(config))
    networks = f"{together} networks at a time" if together > 1 else "one network at a time"
    limit = (
        f"{allowed / GB:.2g} GB (half of the memory that is free; --memory changes it)"
        if memory is None
        else f"the {memory:g} GB of --memory"
    )
    if whole <= allowed:
        return Residence(
            True,
            f"training data stay in memory: {whole / GB:.2g} GB for {networks}, within {limit}",
        )
    if streamed <= allowed:
        return Residence(
            False,
            f"training data are streamed from the store: {whole / GB:.2g} GB for {networks} exceed "
            f"{limit}; {streamed / GB:.2g} GB are in memory at once",
        )
    needed = math.ceil(streamed / GB * 1e3) / 1e3
    raise InputError(
        f"streaming the training data takes {streamed / GB:.2g} GB of memory for {networks}, more "
        f"than {limit}: give --memory {needed:g} where there is as much, fewer --workers, "
        f"or a --buffer of fewer samples than {config.training.buffer}"
    )


def _sizes(config: FitConfig) -> tuple[int, int]:
    """Bytes of one network's data: all of them, and the most that streaming holds at once.

    While one buffer is trained on and the next one is read, two groups of validation missions may
    be in memory as well. What a fixed memory recalls of a buffer is there twice while it is made.
    """
    train, validation = training_lengths(
        config.stores, config.division, config.period, config.held_out
    )
    lengths = train if config.division == "samples" else np.concatenate([train, validation])
    sample = sample_bytes(len(config.features))
    # the period changes what is recalled, and not how much of it
    shape = dataclasses.replace(config.network, inputs=len(config.features), period=1.0)
    recalled = 2 * recalled_columns(shape) * 4
    plan = buffers(train, config.training.buffer)
    held = max(int(train[part].sum()) for part in plan)
    judged = [int(validation[group].sum()) for group in groups_by_length(validation)]
    reading = max(AT_A_TIME, int(lengths.max())) * READING + held * recalled
    ahead = min(2, len(plan)) * held + 2 * max(judged, default=0)
    return int(lengths.sum()) * sample + reading, ahead * sample + reading


def free_memory() -> float:
    """Bytes that this process may take without another one's loss, in its container too."""
    free = [os.sysconf("SC_PHYS_PAGES") * float(os.sysconf("SC_PAGE_SIZE"))]
    text = _read(Path("/proc/meminfo"))
    free += [
        float(line.split()[1]) * 1024.0 for line in text.splitlines() if "MemAvailable" in line
    ]
    limit, used = _read(CGROUPS / "memory.max").strip(), _read(CGROUPS / "memory.current").strip()
    if limit.isdigit() and used.isdigit():
        lines = _read(CGROUPS / "memory.stat").splitlines()
        cached = sum(float(line.split()[1]) for line in lines if line.startswith("inactive_file "))
        free.append(float(limit) - float(used) + cached)
    return max(0.0, min(free))


def _read(path: Path) -> str:
    """A file of the system; empty where it has none."""
    try:
        return path.read_text()
    except OSError:
        return ""


@dataclass(frozen=True)
class Resources:
    """Where networks are trained."""

    executor: Executor | None = None
    """Any of `concurrent.futures`; None trains in this process, one network after the other"""
    workers: int = 1
    """Networks that share the memory of a machine"""
    memory: float | None = None
    """[GB] for the training data of networks that are trained at a time; None: half of what this
    machine has free"""

    @property
    def elsewhere(self) -> bool:
        """Whether the working folder may be another one there."""
        return self.executor is not None and not isinstance(self.executor, _Pool)

    def abandon(self) -> None:
        """End the processes of a pool of ours at once: what they train goes on from checkpoints."""
        if isinstance(self.executor, _Pool):
            self.executor.kill()


QUIET = "ignore:resource_tracker:UserWarning"
"""Of Python's tracker of semaphores, which would write a warning with its source line"""


class _Pool(ProcessPoolExecutor):
    """Processes of this machine, begun afresh: torch's threads do not survive a fork."""

    def __init__(self, workers: int) -> None:
        # killed processes leave semaphores; the tracker, begun with these options, removes them
        if QUIET not in sys.warnoptions:
            sys.warnoptions.append(QUIET)
        context = multiprocessing.get_context("spawn")
        super().__init__(workers, mp_context=context, initializer=end_with, initargs=(os.getpid(),))

    def kill(self) -> None:
        """The standard pool can do this itself from Python 3.14 on."""
        for process in list((self._processes or {}).values()):
            process.kill()


@contextlib.contextmanager
def training_resources(
    workers: int | None = None, executor: Executor | None = None, memory: float | None = None
) -> Iterator[Resources]:
    """What trains, for as long as the context lasts.

    Args:
      workers: processes of this machine; 1 trains in this one, None is as many as it may use CPUs.
      executor: trains instead of such processes; it must reach run and store by the same paths.
      memory: see `Resources`; with an executor it is what each network may take.

    Raises:
      InputError: fewer than one worker, or workers and an executor.
    """
    if executor is not None:
        if workers is not None:
            raise InputError("give either workers or an executor, which has its own")
        yield Resources(executor, memory=memory)
        return
    workers = processors() if workers is None else workers
    if workers < 1:
        raise InputError(f"workers must be at least 1, not {workers}")
    if workers == 1:
        yield Resources(memory=memory)
        return
    with _Pool(workers) as pool:
        found = Resources(pool, workers, memory)
        try:
            yield found
        except BaseException:
            found.abandon()
            raise


def train(
    job: TrainingJob,
    folder: Path,
    report: Callable[[TrainingReport], None],
    *,
    resident: bool = True,
) -> TrainingReport | None:
    """Train one network and save it; its last report, None when nothing was left to do.

    Args:
      resident: keep the training data in memory; else read them from the store as they are needed.
    """
    config = job.config
    start = None
    if config.start is not None:
        members = open_run(config.start).networks()[job.target].members
        start = members[job.member % len(members)]
        if start.features != config.features:
            raise InputError(f"run {config.start} has other inputs; leave the inputs to --start")
    checkpoint = folder / f"{job.name}{CHECKPOINT}"
    with prepare(
        config.stores,
        target=job.target,
        features=config.features,
        division=config.division,
        seed=config.training.seed,
        mirror=config.mirror,
        period=config.period,
        scales=None if start is None else start.normalisation,
        held_out=config.held_out,
        labels=config.labels,
        spread=HULLS[config.hulls],
        resident=resident,
    ) as data:
        threads = torch.get_num_threads()
        try:
            trained = Trainer(
                dataclasses.replace(config.network, period=data.period),
                dataclasses.replace(config.training, seed=job.seed),
                data.train,
                data.validation,
                target_scale=data.normalisation.target_scale,
                checkpoint=checkpoint,
                report=report,
                start=None if start is None else start.network.state_dict(),
            ).run()
        finally:
            torch.set_num_threads(threads)  # the caller's, who may go on in this process
    Predictor(trained.network.cpu(), data.normalisation).save(stem(folder, job.target, job.member))
    checkpoint.unlink(missing_ok=True)  # now that what came of it is safe
    return trained.history[-1] if trained.history else None
