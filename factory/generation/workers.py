"""Pool: worker processes that each fly one mission after the other.

Workers are forked once everything is imported and compiled, and before this process has threads.
They take mission numbers from one pipe, whoever is free the next one, and keep what they make in
the checkpoint. A worker whose parent has died stops before its next mission.
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import struct
import traceback
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import ForkProcess
from types import TracebackType
from typing import Self

from factory.generation.attempts import fly_mission
from factory.generation.checkpoint import Checkpoint
from factory.recipe.recipe import Recipe
from twin.errors import TwinError
from twin.physics.quiet import quiet_mujoco

WAITING = 4
"""Numbers per worker that wait in the pipe: nobody waits for the parent to notice."""
_NUMBER = struct.Struct("<q")
_DEATH_S = 1.0
"""[s] for the system to say how a worker ended"""


@dataclass(frozen=True)
class Done:
    """A mission that a worker has kept."""

    mission: int
    failures: int


@dataclass(frozen=True)
class Broken:
    """A worker's last words."""

    error: BaseException | str


class Pool:
    """`workers` processes; a context manager.

    Leaving it lets each worker finish the mission that it flies; leaving it with a second
    interrupt ends them at once.
    """

    def __init__(self, recipe: Recipe, checkpoint: Checkpoint, *, workers: int, lock: int):
        self._recipe, self._checkpoint = recipe, checkpoint
        self._workers, self._lock = workers, lock
        self._processes: dict[Connection, ForkProcess] = {}

    def __enter__(self) -> Self:
        context = multiprocessing.get_context("fork")
        parent = os.getpid()
        self._numbers, self._feed = os.pipe()
        for _ in range(self._workers):
            here, there = context.Pipe(duplex=False)
            inherited = [self._lock, self._feed, here.fileno()]
            inherited += [connection.fileno() for connection in self._processes]
            process = context.Process(
                target=_work,
                args=(self._numbers, there, self._recipe, self._checkpoint, parent, inherited),
                daemon=True,
            )
            with warnings.catch_warnings():
                # Python 3.12 warns of forks beside threads; the ones there may be are idle pools
                # of numeric libraries, which take forks into account
                warnings.simplefilter("ignore", DeprecationWarning)
                process.start()
            there.close()
            self._processes[here] = process
        return self

    def run(self, missions: Iterable[int]) -> Iterator[Done]:
        """Have `missions` flown; yields each as it is kept, in any order.

        Raises:
          TwinError, OSError: what stopped a worker.
        """
        waiting = iter(missions)
        flying = sum(self._hand_out(waiting) for _ in range(WAITING * self._workers))
        return self._collect(waiting, flying)

    def _collect(self, waiting: Iterator[int], flying: int) -> Iterator[Done]:
        while flying:
            for ready in multiprocessing.connection.wait(list(self._processes)):
                assert isinstance(ready, Connection)
                try:
                    answer = ready.recv()
                except (EOFError, ConnectionResetError):
                    raise self._death(ready) from None
                if isinstance(answer, Broken):
                    raise _as_error(answer)
                flying += self._hand_out(waiting) - 1
                yield answer

    def _hand_out(self, waiting: Iterator[int]) -> int:
        """Put the next number into the pipe; 1 if there was one."""
        mission = next(waiting, None)
        if mission is None:
            return 0
        os.write(self._feed, _NUMBER.pack(mission))
        return 1

    def _death(self, connection: Connection) -> TwinError:
        process = self._processes[connection]
        process.join(_DEATH_S)
        code = process.exitcode
        how = f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"
        return TwinError(f"a worker process ended {how}; too little memory is the usual reason")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # the only reader besides the workers: what nobody has taken is taken back
        os.set_blocking(self._numbers, False)
        os.close(self._feed)
        while _take(self._numbers) is not None:
            pass
        os.close(self._numbers)
        for connection in self._processes:
            connection.close()
        try:
            for process in self._processes.values():
                process.join()
        except KeyboardInterrupt:
            for process in self._processes.values():
                process.kill()
            raise


def _take(numbers: int) -> int | None:
    """The next mission number; None when there will be no more. Reads of a pipe are whole."""
    try:
        data = os.read(numbers, _NUMBER.size)
    except BlockingIOError:
        return None
    return int(_NUMBER.unpack(data)[0]) if data else None


def _as_error(broken: Broken) -> BaseException:
    if isinstance(broken.error, BaseException):
        return broken.error
    return RuntimeError(f"a worker failed: {broken.error}")


def _work(
    numbers: int,
    connection: Connection,
    recipe: Recipe,
    checkpoint: Checkpoint,
    parent: int,
    inherited: list[int],
) -> None:
    """A worker's life. `inherited` are descriptors that only the parent may hold."""
    for descriptor in inherited:
        os.close(descriptor)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what an interrupt means
    while (mission := _take(numbers)) is not None and os.getppid() == parent:
        try:
            with quiet_mujoco():  # an unstable mission is recorded with its parameters instead
                flown, signals = fly_mission(recipe, mission)
            checkpoint.write_mission(flown, signals)
            answer: Done | Broken = Done(mission, len(flown.failures))
        except (TwinError, OSError) as error:
            answer = Broken(error)
        except Exception:
            answer = Broken(traceback.format_exc(limit=-3))
        try:
            connection.send(answer)
        except (BrokenPipeError, ConnectionResetError):
            return
        if isinstance(answer, Broken):
            return
