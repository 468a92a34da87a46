"""Processes of the benchmarks: commands that are timed, forks that are waited for or killed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from twin.errors import TwinError

ROOT = Path(__file__).resolve().parents[1]
DONE, TOLD, CRASHED = 0, 3, 4
"""Exit codes of a fork: done, one line of error, a traceback"""
WAIT_S = 300.0
"""[s] after which a process that should have ended is taken for hung"""
EVERY_S = 0.5
"""[s] between looks at the memory: each costs the kernel a walk through every page"""


class Ran(NamedTuple):
    """A command that ran to its end."""

    wall_s: float
    cpu_s: float
    memory: int
    """[bytes] Most that one of its processes held"""
    memory_of_all: int
    """[bytes] Most that the process and its children held, shared pages counted once"""
    said: str


def ran(command: Sequence[str]) -> Ran:
    """Run a command to its end.

    Raises:
      SystemExit: it failed.
    """
    begun, most, ended = time.perf_counter(), 0, threading.Event()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=ROOT)

    def watch() -> None:
        nonlocal most
        while not ended.is_set():
            most = max(most, sum(map(_proportional, family(process.pid))))
            ended.wait(EVERY_S)

    threading.Thread(target=watch, daemon=True).start()
    said = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - begun
    ended.set()
    if status:
        raise SystemExit(f"{' '.join(command)} ended with {os.waitstatus_to_exitcode(status)}")
    cpu = used.ru_utime + used.ru_stime
    return Ran(wall, cpu, 1024 * used.ru_maxrss, most, said.decode())


def family(pid: int) -> list[int]:
    """A process and its children."""
    children = Path(f"/proc/{pid}/task").glob("*/children")
    return [pid, *(int(child) for path in children for child in _read(path).split())]


def _read(path: Path) -> str:
    with contextlib.suppress(OSError):
        return path.read_text()
    return ""


def _proportional(pid: int) -> int:
    for line in _read(Path(f"/proc/{pid}/smaps_rollup")).splitlines():
        if line.startswith("Pss:"):
            return 1024 * int(line.split()[1])
    return 0


def fork(work: Callable[[], object]) -> int:
    """Do something in a forked process with a session of its own; return its number."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        return child
    code = CRASHED
    try:
        os.setsid()
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        work()
        code = DONE
    except TwinError as error:
        code = TOLD if "\n" not in str(error) else CRASHED
    except BaseException:
        traceback.print_exc()
    os._exit(code)


def wait(process: int, *, kill: bool = False) -> int:
    """Exit code of a forked process, killed first or not; below 0 is the signal that ended it."""
    if kill:
        os.kill(process, signal.SIGKILL)  # one that has ended is there until it is waited for
    deadline = time.monotonic() + WAIT_S
    while time.monotonic() < deadline:
        found, status = os.waitpid(process, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    raise TimeoutError(f"process {process} did not end in {WAIT_S:g} s")


def done(work: Callable[[], object]) -> bool:
    """Do something in a fork; True where it ended without an error."""
    return wait(fork(work)) == DONE
