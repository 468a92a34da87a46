"""Resources: the processes that train a run's networks, and the memory for their data.

A job trains and saves one network of a run. A worker process ends when its parent ends, even by a
kill. The training data stay in memory if there is room; otherwise they are streamed.
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
from learn.data.sequences import Sequences
from learn.networks.base import groups_by_length
from learn.networks.predictor import Predictor
from learn.run import open_run, stem
from learn.run_folder import CHECKPOINT
from learn.training.feed import recalled_columns
from learn.training.fit_config import FitConfig, TrainingJob
from learn.training.held_back import HeldRows, filter_kept
from learn.training.trainer import Trainer, TrainingReport
from twin.errors import InputError
from twin.navigation.flight_filter import HULLS
from twin.numbers import processors
from twin.records.windows import buffers

CHECK_S = 1.0
"""[s] Time between checks that the parent process lives."""


def end_with(parent: int) -> None:
    """Make this worker process end within about CHECK_S after its parent, even after a kill.

    Keyboard interrupts are ignored here: they reach all processes, and the parent handles them.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(CHECK_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


GB = 1e9
SHARE = 0.5
"""[1] Fraction of the free memory for training data; the rest is for programs and libraries"""
READING = 400
"""Bytes per sample while channels become features"""
CGROUPS = Path("/sys/fs/cgroup")


@dataclasses.dataclass(frozen=True)
class Residence:
    """Place of the training data: memory or store."""

    resident: bool
    """True: in memory; False: read from the store on each use"""
    told: str
    """Choice and its reason in one line"""


def choose_residence(config: FitConfig, together: int, memory: float | None = None) -> Residence:
    """Choose the place of the training data, for `together` networks trained at a time.

    Args:
      memory: [GB] limit for the data of these networks; None: half of the machine's free memory.

    Raises:
      InputError: the buffers alone exceed the limit.
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
    """Bytes of one network's data when resident, and the largest number when streamed.

    Streaming holds two buffers, one in use and one being read, and up to two groups of validation
    missions. A fixed memory of a buffer exists twice while it is computed.
    """
    train, validation = training_lengths(
        config.stores, config.division, config.period, config.held_out
    )
    lengths = train if config.division == "samples" else np.concatenate([train, validation])
    sample = sample_bytes(len(config.features))
    # the period changes the fixed memory's values, not its size
    shape = dataclasses.replace(config.network, inputs=len(config.features), period=1.0)
    recalled = 2 * recalled_columns(shape) * 4
    plan = buffers(train, config.training.buffer)
    held = max(int(train[part].sum()) for part in plan)
    judged = [int(validation[group].sum()) for group in groups_by_length(validation)]
    reading = max(AT_A_TIME, int(lengths.max())) * READING + held * recalled
    ahead = min(2, len(plan)) * held + 2 * max(judged, default=0)
    return int(lengths.sum()) * sample + reading, ahead * sample + reading


def free_memory() -> float:
    """Bytes of free memory, within the limit of the process's container."""
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
    """Text of a system file; empty if the file is missing."""
    try:
        return path.read_text()
    except OSError:
        return ""


@dataclass(frozen=True)
class Resources:
    """Executor and memory for the training of networks."""

    executor: Executor | None = None
    """Executor of `concurrent.futures`; None trains in this process, one network at a time"""
    workers: int = 1
    """Networks trained at a time that share a machine's memory"""
    memory: float | None = None
    """[GB] Limit for the data of the networks trained at a time; None: half of the machine's free
    memory"""

    @property
    def elsewhere(self) -> bool:
        """True if workers may have another working folder, so that paths must be absolute."""
        return self.executor is not None and not isinstance(self.executor, _Pool)

    def abandon(self) -> None:
        """Kill the processes of our own pool at once; their checkpoints stay."""
        if isinstance(self.executor, _Pool):
            self.executor.kill()


QUIET = "ignore:resource_tracker:UserWarning"
"""Warning filter for Python's tracker of semaphores, which otherwise warns after a kill"""


class _Pool(ProcessPoolExecutor):
    """Pool of spawned processes on this machine: torch's threads do not survive a fork."""

    def __init__(self, workers: int) -> None:
        # killed processes leave semaphores, which the tracker removes; it inherits these options
        if QUIET not in sys.warnoptions:
            sys.warnoptions.append(QUIET)
        context = multiprocessing.get_context("spawn")
        super().__init__(workers, mp_context=context, initializer=end_with, initargs=(os.getpid(),))

    def kill(self) -> None:
        """Kill all processes; Python 3.14 has a standard method for this."""
        for process in list((self._processes or {}).values()):
            process.kill()


@contextlib.contextmanager
def training_resources(
    workers: int | None = None, executor: Executor | None = None, memory: float | None = None
) -> Iterator[Resources]:
    """Context manager that provides `Resources`, with a pool of processes if needed.

    Args:
      workers: processes of this machine; 1 trains in this process, None takes one per usable CPU.
      executor: executor to use instead; its workers must reach run and store by the same paths.
      memory: see `Resources`; with an executor, the limit is for each network.

    Raises:
      InputError: `workers` is below 1, or is given together with an executor.
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
    held: Path | None = None,
) -> TrainingReport | None:
    """Train one network and save it; returns its last report, or None without any validation.

    Args:
      held: file of `HeldRows` that decide on a training from a start in place of the validation
        missions.
      resident: keep the training data in memory; if False, read them from the store on each use.
    """
    config = job.config
    start = None
    if config.start is not None:
        first = open_run(config.start)
        members = first.networks(plain=False)[job.target].members
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
        training = data.train
        if held is not None and isinstance(training, Sequences):
            training = filter_kept(training, data.normalisation)
        threads = torch.get_num_threads()
        try:
            trained = Trainer(
                dataclasses.replace(config.network, period=data.period),
                dataclasses.replace(config.training, seed=job.seed),
                training,
                data.validation,
                target_scale=data.normalisation.target_scale,
                checkpoint=checkpoint,
                report=report,
                start=None if start is None else start.network.state_dict(),
                held=None if held is None else HeldRows.load(held),
            ).run()
        finally:
            torch.set_num_threads(threads)  # restores the caller's setting
    Predictor(trained.network.cpu(), data.normalisation).save(stem(folder, job.target, job.member))
    checkpoint.unlink(missing_ok=True)  # only now that the network is saved
    return trained.history[-1] if trained.history else None
