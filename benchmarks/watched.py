"""Watched: memory, CPU time and open files of a process and its children."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

TICKS = os.sysconf("SC_CLK_TCK")
"""of the kernel's clock in a second"""


class Use(NamedTuple):
    """What a process and its children hold and have taken."""

    memory: int
    """[bytes], shared pages counted once"""
    cpu_s: float
    """[s] of those alive now"""
    files: int
    """open files"""


def use_of(pid: int) -> Use:
    """Look now; what has ended meanwhile counts nothing."""
    pids = family(pid)
    return Use(
        sum(_proportional(one) for one in pids),
        sum(_cpu_s(one) for one in pids),
        sum(_open_files(one) for one in pids),
    )


def family(pid: int) -> list[int]:
    """A process and its children."""
    children = Path(f"/proc/{pid}/task").glob("*/children")
    return [pid, *(int(child) for path in children for child in _read(path).split())]


class Watched(threading.Thread):
    """Looks at a process and its children twice a second: looking costs the kernel a walk through
    every page."""

    def __init__(self, pid: int, tell: Callable[[Use], None] | None = None, every_s: float = 0.5):
        """`tell` is called with what every look finds."""
        super().__init__(daemon=True)
        self.pid, self.peak, self.running = pid, 0, True
        self._tell, self._every_s = tell, every_s

    def run(self) -> None:
        """Look until `running` is false."""
        while self.running:
            found = use_of(self.pid)
            self.peak = max(self.peak, found.memory)
            if self._tell is not None:
                self._tell(found)
            time.sleep(self._every_s)


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""


def _proportional(pid: int) -> int:
    for line in _read(Path(f"/proc/{pid}/smaps_rollup")).splitlines():
        if line.startswith("Pss:"):
            return 1024 * int(line.split()[1])
    return 0


def _cpu_s(pid: int) -> float:
    fields = _read(Path(f"/proc/{pid}/stat")).rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS if fields else 0.0


def _open_files(pid: int) -> int:
    try:
        return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())
    except OSError:
        return 0
