"""Workers: train a run's networks with an executor, several at a time.

A network is one task, which writes checkpoints and weights into the run's folder. Its reports go
through a file in that folder, so any executor works, also on another machine that has the folder
at the same path. The fit that submits the tasks writes a random word into the folder and removes
it at its end. If the word is gone or differs, a task ends at its next report.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import threading
import uuid
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from learn.run_folder import resume_command
from learn.seams import NETWORKS, OPTIMISERS
from learn.training.fit_config import TrainingJob
from learn.training.resources import Resources, train
from learn.training.trainer import TrainingReport
from twin.errors import TwinError
from twin.records.storage.store_path import store_path

POLL_S = 0.2
"""[s] Time between checks for new reports"""
WORD = ".training"
"""File in a run's folder with the random word of the fit that trains the run"""
REPORTS = ".reports"
"""Ending of the file with the reports of one network"""
_TRAINING_LOCK = threading.Lock()
"""Lock of a training: torch's random state and thread count belong to the whole process"""


@dataclasses.dataclass(frozen=True)
class Task:
    """Network to train, with its run's folder."""

    job: TrainingJob
    folder: Path
    """Folder of the run"""
    resident: bool
    """True: keep the training data in memory"""
    held: Path | None = None
    """File of `learn.training.held_back.HeldRows`"""

    def train(self, report: Callable[[TrainingReport], None]) -> TrainingReport | None:
        """Train the network in this process."""
        return train(self.job, self.folder, report, resident=self.resident, held=self.held)

    @property
    def reports(self) -> Path:
        """File of the network's reports."""
        return self.folder / f".{self.job.name}{REPORTS}"

    def absolute(self) -> Task:
        """Copy of the task with absolute paths."""
        config = self.job.config
        start, places = config.start, map(store_path, config.stores)
        store, *more = [str(p.absolute() if isinstance(p, Path) else p) for p in places]
        config = dataclasses.replace(
            config,
            store=store,
            more_stores=tuple(more),
            start=None if start is None else str(Path(start).absolute()),
        )
        job = dataclasses.replace(self.job, config=config)
        held = None if self.held is None else self.held.absolute()
        return dataclasses.replace(self, job=job, folder=self.folder.absolute(), held=held)


Kinds = tuple[dict[str, Any], dict[str, Any]]
"""Networks and optimisers that users registered in this process, to register in workers"""
Seen = Callable[[Task, TrainingReport], None]
Finished = Callable[[Task, TrainingReport | None], None]


def train_tasks(
    tasks: Sequence[Task], resources: Resources, seen: Seen, finished: Finished
) -> None:
    """Train all tasks; an interrupt or an error ends them, and their checkpoints stay.

    Args:
      seen: called in this process with every report of every network.
      finished: called in this process when a network is saved, with its last report or None.

    Raises:
      TwinError: a task has failed.
    """
    if resources.executor is None:
        for task in tasks:

            def report(found: TrainingReport, task: Task = task) -> None:
                seen(task, found)

            finished(task, task.train(report))
        return
    word, kinds = uuid.uuid4().hex, (NETWORKS.registered(), OPTIMISERS.registered())
    letters = {task: _ReportReader(task.reports) for task in tasks}
    folders = {task.folder for task in tasks}
    for folder in folders:
        (folder / WORD).write_text(word)
    futures: dict[Future[TrainingReport | None], Task] = {}
    try:
        for task in tasks:
            sent = task.absolute() if resources.elsewhere else task
            futures[resources.executor.submit(work, sent, word, kinds)] = task
        waiting = set(futures)
        while waiting:
            done, waiting = concurrent.futures.wait(
                waiting, POLL_S, concurrent.futures.FIRST_COMPLETED
            )
            for task, letter in letters.items():
                for found in letter.new():
                    seen(task, found)
            for future in done:
                finished(futures[future], _result(future, futures[future]))
    except BaseException:
        for future in futures:
            future.cancel()
        resources.abandon()
        raise
    finally:
        for folder in folders:
            (folder / WORD).unlink(missing_ok=True)
        for task in tasks:
            task.reports.unlink(missing_ok=True)


def work(task: Task, word: str, kinds: Kinds) -> TrainingReport | None:
    """Train one network in a worker process.

    Raises:
      TwinError: the training failed; any other error becomes one, which can be pickled.
    """
    for registry, own in zip((NETWORKS, OPTIMISERS), kinds, strict=True):
        registry.adopt(own)
    try:
        with _TRAINING_LOCK, task.reports.open("a") as file:
            file.write("\n")  # a killed worker may have left half a line

            def report(found: TrainingReport) -> None:
                if _word_of(task.folder) != word:
                    raise TwinError(f"the fit of {task.job.name} in {task.folder} has ended")
                file.write(json.dumps(dataclasses.asdict(found)) + "\n")
                file.flush()

            return task.train(report)
    except TwinError as error:
        raise type(error)(*error.args) from None
    except Exception as error:  # passed to the parent process, which reports to the user
        raise TwinError(
            f"training of {task.job.name} failed: {type(error).__name__}: {error}"
        ) from None


def _word_of(folder: Path) -> str:
    """Word in a run's folder; empty if the fit that wrote it has ended."""
    try:
        return (folder / WORD).read_text()
    except OSError:
        return ""


def _result(future: Future[TrainingReport | None], task: Task) -> TrainingReport | None:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise TwinError(
            f"a process that trains ended abruptly, perhaps that of {task.job.name}; too little "
            f"memory is the usual reason (see --memory). Continue with "
            f"{resume_command(task.folder)}"
        ) from error


class _ReportReader:
    """Reader of a file of reports, which returns each report once."""

    def __init__(self, path: Path) -> None:
        self._path, self._place = path, 0
        path.unlink(missing_ok=True)  # left by a fit that was killed

    def new(self) -> list[TrainingReport]:
        """Reports written since the last call."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._place)
                text = file.read()
        except FileNotFoundError:
            return []
        whole = text.rfind(b"\n") + 1
        self._place += whole
        found = []
        for line in text[:whole].splitlines():
            try:
                found.append(TrainingReport(**json.loads(line)))
            except ValueError:  # an empty line, or half a line of a killed worker
                continue
        return found
