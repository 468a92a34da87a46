"""Resources: the processes that train networks side by side, and the memory for their data."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass

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


class _Pool(ProcessPoolExecutor):
    """Processes of this machine, begun afresh: torch's threads do not survive a fork."""

    def __init__(self, workers: int) -> None:
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
