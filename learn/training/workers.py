"""Workers: the networks of a run side by side, a process of one thread each."""

from __future__ import annotations

import dataclasses
import multiprocessing
import os
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from learn.networks.registry import NETWORKS
from learn.runs.place import resume_command
from learn.training.job import train
from learn.training.optimisers.registry import OPTIMISERS
from learn.training.settings import Job
from learn.training.trainer import Report
from learn.training.watchdog import end_with
from twin.errors import TwinError

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess


@dataclasses.dataclass(frozen=True)
class _Worker:
    """A process that trains one network, and the end of the pipe on which it tells of it."""

    job: Job
    process: BaseProcess
    messages: Connection


@dataclasses.dataclass(frozen=True)
class Kinds:
    """What users registered in this process, for the workers."""

    networks: dict[str, Any]
    optimisers: dict[str, Any]


def _kinds() -> Kinds:
    return Kinds(NETWORKS.registered(), OPTIMISERS.registered())


def train_in_workers(
    jobs: Sequence[Job],
    folder: Path,
    workers: int,
    seen: Callable[[Job, Report], None],
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
                    kind, content = "error", _death(worker, folder)
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
    process = context.Process(
        target=work,
        args=(job, folder, sender, os.getpid(), _kinds()),
        daemon=True,
        name=job.name,
    )
    process.start()
    sender.close()  # so that the process's death shows as the end of the messages
    return _Worker(job, process, receiver)


def work(job: Job, folder: Path, messages: Connection, parent: int, kinds: Kinds) -> None:
    """One process: reports and the result go through the pipe."""
    import logging
    import signal
    import sys

    def leave(*_: object) -> None:
        # reads of a store that are under way are dropped, of which nobody needs to be told
        logging.getLogger("asyncio").disabled = True
        sys.exit()

    end_with(parent)  # after an interrupt the parent ends this process, which leaves in good order
    signal.signal(signal.SIGTERM, leave)
    NETWORKS.adopt(kinds.networks)
    OPTIMISERS.adopt(kinds.optimisers)
    try:
        last = train(job, folder, lambda report: messages.send(("report", report)))
    except TwinError as error:
        messages.send(("error", type(error)(*error.args)))
    except Exception as error:  # carried to the parent, which alone may speak to the user
        text = f"training of {job.name} failed: {type(error).__name__}: {error}"
        messages.send(("error", TwinError(text)))
    else:
        messages.send(("done", last))


def _death(worker: _Worker, folder: Path) -> TwinError:
    worker.process.join()
    return TwinError(
        f"the process that trains {worker.job.name} ended with code {worker.process.exitcode} "
        f"(out of memory?); continue with {resume_command(folder)}"
    )
