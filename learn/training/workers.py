"""Workers: networks of a run trained side by side by an executor.

A network is one task, which leaves its checkpoints and weights in the folder of its run. What it
reports on the way goes through a file there too, so that any executor will do, one of another
machine that reaches the folder by the same path as well. A task whose start has ended, by an
interrupt say, ends at its next report: the word of that start is gone from the folder.
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
"""[s] between looks for reports"""
WORD = ".training"
"""File in a run's folder with the word of the start that trains it"""
REPORTS = ".reports"
"""Ending of the file with the reports of one network"""
_ALONE = threading.Lock()
"""Held by what trains: torch's random numbers and threads are those of the whole process"""


@dataclasses.dataclass(frozen=True)
class Task:
    """A network to train."""

    job: TrainingJob
    folder: Path
    """Of its run"""
    resident: bool
    """Keep its training data in memory"""

    @property
    def reports(self) -> Path:
        """Where it reports."""
        return self.folder / f".{self.job.name}{REPORTS}"

    def absolute(self) -> Task:
        """The same with whole paths."""
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
        return dataclasses.replace(self, job=job, folder=self.folder.absolute())


Kinds = tuple[dict[str, Any], dict[str, Any]]
"""Networks and optimisers that users registered in this process, for the others"""
Seen = Callable[[Task, TrainingReport], None]
Finished = Callable[[Task, TrainingReport | None], None]


def train_tasks(
    tasks: Sequence[Task], resources: Resources, seen: Seen, finished: Finished
) -> None:
    """Train all; an interrupt or an error ends them, their checkpoints stay.

    Args:
      seen: called here with every report of every network.
      finished: called here when one is saved, with its last report; None: nothing was left to do.

    Raises:
      TwinError: what stopped one of them.
    """
    if resources.executor is None:
        for task in tasks:

            def report(found: TrainingReport, task: Task = task) -> None:
                seen(task, found)

            finished(task, train(task.job, task.folder, report, resident=task.resident))
        return
    word, kinds = uuid.uuid4().hex, (NETWORKS.registered(), OPTIMISERS.registered())
    letters = {task: _Letters(task.reports) for task in tasks}
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
    """Train one network, in whatever process an executor has.

    Raises:
      TwinError: what stopped it, as one that travels between processes.
    """
    for registry, own in zip((NETWORKS, OPTIMISERS), kinds, strict=True):
        registry.adopt(own)
    try:
        with _ALONE, task.reports.open("a") as file:
            file.write("\n")  # a worker that was lost may have left half a line

            def report(found: TrainingReport) -> None:
                if _word_of(task.folder) != word:
                    raise TwinError(f"the fit of {task.job.name} in {task.folder} has ended")
                file.write(json.dumps(dataclasses.asdict(found)) + "\n")
                file.flush()

            return train(task.job, task.folder, report, resident=task.resident)
    except TwinError as error:
        raise type(error)(*error.args) from None
    except Exception as error:  # carried to the parent, which alone may speak to the user
        raise TwinError(
            f"training of {task.job.name} failed: {type(error).__name__}: {error}"
        ) from None


def _word_of(folder: Path) -> str:
    """Empty where the start that wrote it has ended."""
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


class _Letters:
    """The reports in a file, each once."""

    def __init__(self, path: Path) -> None:
        self._path, self._place = path, 0
        path.unlink(missing_ok=True)  # of a start that was killed

    def new(self) -> list[TrainingReport]:
        """Those that were written since the last time."""
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
            except ValueError:  # nothing, or what a lost worker did not finish
                continue
        return found
