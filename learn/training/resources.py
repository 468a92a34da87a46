"""Resources: the processes that train networks side by side, and the memory for their data.

Job: one network of a run, trained and saved.
"""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import torch

from learn.data.preparation import prepare
from learn.networks.predictor import Predictor
from learn.runs.run import open_run, stem
from learn.runs.run_folder import CHECKPOINT
from learn.training.settings import TrainingJob
from learn.training.trainer import Trainer, TrainingReport
from learn.training.watchdog import end_with
from twin.errors import InputError


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
    workers = len(os.sched_getaffinity(0)) if workers is None else workers
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
        config.store,
        target=job.target,
        features=config.features,
        division=config.division,
        seed=config.training.seed,
        mirror=config.mirror,
        period=config.period,
        scales=None if start is None else start.normalisation,
        held_out=config.held_out,
        labels=config.labels,
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
