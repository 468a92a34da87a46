"""Endings: what ends a program from outside, Ctrl-C, SIGTERM or SIGHUP, and how that is told.

All three are a KeyboardInterrupt, so that what a command has begun is tidied up and it says how to
go on, whoever ends it: a person, a batch system at the end of a job, a terminal that closes.

Runnable: what every subcommand is to the program that runs it.
"""

from __future__ import annotations

import os
import signal
import threading
from types import FrameType
from typing import Protocol

from twin.cli.console import Console

WORDS = {
    signal.SIGINT: "interrupted",
    signal.SIGTERM: "ended by SIGTERM",
    signal.SIGHUP: "ended by SIGHUP",
}


def interruption(error: BaseException) -> KeyboardInterrupt | None:
    """The interruption that an error hides, or None.

    A signal that arrives while compiled code calls Python leaves its exception set behind a result.
    Python then raises a SystemError with the interruption as its cause, and another one at each
    caller that is compiled too.

    Args:
      error: what ended a command. Only behind a SystemError does an interruption count: an error of
        what tidies up after one is told as itself.
    """
    one: BaseException | None = error
    compiled = False
    seen: set[int] = set()
    while one is not None and id(one) not in seen:
        if isinstance(one, KeyboardInterrupt):
            return one if compiled or one is error else None
        seen.add(id(one))
        compiled = compiled or isinstance(one, SystemError)
        one = one.__cause__ or one.__context__
    return None


class Ended(KeyboardInterrupt):
    """A signal ended the program that is not Ctrl-C's."""


class Endings:
    """A context in which SIGTERM and SIGHUP end the program as Ctrl-C does.

    A signal that is ignored, as SIGHUP under nohup, or that somebody else handles, is left alone.
    Processes that this one forks end at once by them, as they would without.
    """

    def __init__(self) -> None:
        self._signal = signal.SIGINT
        self._process = os.getpid()
        self._taken: list[signal.Signals] = []

    @property
    def word(self) -> str:
        """How it ended."""
        return WORDS[self._signal]

    @property
    def code(self) -> int:
        """Exit code as shells report the signal."""
        return 128 + self._signal

    def __enter__(self) -> Endings:
        if threading.current_thread() is threading.main_thread():
            for one in (signal.SIGTERM, signal.SIGHUP):
                if signal.getsignal(one) is signal.SIG_DFL:
                    signal.signal(one, self._end)
                    self._taken.append(one)
        return self

    def __exit__(self, *_: object) -> None:
        for one in self._taken:
            signal.signal(one, signal.SIG_DFL)

    def _end(self, number: int, frame: FrameType | None) -> None:
        if os.getpid() != self._process:  # a forked process ends by it without a word
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
            return
        self._signal = signal.Signals(number)
        raise Ended


class Runnable(Protocol):
    """An instance of a subcommand's dataclass."""

    def run(self, console: Console) -> int:
        """Do the work and return the exit code."""
        ...
