"""Injector: faults in the file operations of a process, through a library in front of C's own."""

from __future__ import annotations

import ctypes
import enum
import os
import shutil
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).with_name("injector.c")


class Fault(enum.IntEnum):
    """What happens at an operation."""

    NOTHING = 0
    IO_ERROR = 1
    """it fails once with EIO"""
    FULL_DISK = 2
    """it, and all later ones that need room, fail with ENOSPC"""
    KILL = 3
    """the process ends before it"""
    POWER_LOSS = 4
    """the process ends before it, and what was not synced is empty"""


FAULTS = tuple(fault for fault in Fault if fault)


def compiler() -> str | None:
    """The C compiler that the injector needs; None without one."""
    return shutil.which("cc") or shutil.which("gcc")


def library(folder: Path) -> Path:
    """The injector, compiled into a folder of the caller's where it is not there yet."""
    path = folder / "injector.so"
    if not path.is_file():
        found = compiler()
        assert found is not None, "faults are injected through a C library: install a C compiler"
        subprocess.run([found, "-shared", "-fPIC", "-O1", "-o", path, SOURCE, "-ldl"], check=True)
    return path


def run_injected(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run Python with the injector in front of the C library; `folder` is for the injector."""
    environment = {**os.environ, "LD_PRELOAD": str(library(folder)), "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, *arguments],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


class Injector:
    """The injector of this process, which `run_injected` started."""

    def __init__(self) -> None:
        self._library = ctypes.CDLL(None)
        assert hasattr(self._library, "fault_arm"), "not started by run_injected"
        for name in ("fault_count", "fault_unsynced"):
            getattr(self._library, name).restype = ctypes.c_long

    def arm(self, folder: Path, at: int, fault: Fault) -> None:
        """From now on: the fault at operation `at` (from 1) below a folder; 0 only counts."""
        self._library.fault_arm(os.fsencode(folder), ctypes.c_long(at), int(fault))

    def disarm(self) -> None:
        """No more faults; what was counted is forgotten."""
        self._library.fault_arm(b"", ctypes.c_long(0), int(Fault.NOTHING))

    @property
    def count(self) -> int:
        """Operations since `arm`."""
        return int(self._library.fault_count())

    @property
    def unsynced(self) -> int:
        """Files that were written and not synced."""
        return int(self._library.fault_unsynced())
