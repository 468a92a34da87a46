"""Processes of the benchmarks: timed commands, and forks to wait for or to kill."""

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
"""[s] Time after which a process counts as hung"""
EVERY_S = 0.5
"""[s] Time between memory readings: each makes the kernel walk through every page"""


class Ran(NamedTuple):
    """Result of a command that ended."""

    wall_s: float
    cpu_s: float
    memory: int
    """[bytes] Largest memory of one of its processes"""
    memory_of_all: int
    """[bytes] Largest memory of the process and its children, shared pages counted once"""
    said: str


def ran(command: Sequence[str]) -> Ran:
    """Run a command to its end.

    Raises:
      SystemExit: the command failed.
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
    """Numbers of a process and its children."""
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
    """Run `work` in a forked process with its own session; return its number."""
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
    """Exit code of a forked process, killed first if `kill`; below 0 is the ending signal."""
    if kill:
        os.kill(process, signal.SIGKILL)  # an ended process stays until `waitpid`
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
    """Run `work` in a fork; True if it ended without an error."""
    return wait(fork(work)) == DONE
