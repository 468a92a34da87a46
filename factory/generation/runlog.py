"""Run log: which machine made a store, when and by which command, beside the store.

None of it is in the store, whose bytes are the same wherever it is made. `NAME.log` has one line of
JSON for each run.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import platform
import socket
from pathlib import Path

from factory.recipe.recipe import Recipe, versions


def log_of(store: Path) -> Path:
    """The log of a store."""
    return store.with_name(store.name + ".log")


def note(store: Path, recipe: Recipe, command: str) -> None:
    """Add a line; raises OSError."""
    entry = {
        "time": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "command": command,
        "recipe": recipe.digest,
        "host": socket.gethostname(),
        "processor": _processor(),
        "processors": os.cpu_count(),
        "versions": versions(),
    }
    with log_of(store).open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")
        file.flush()
        os.fsync(file.fileno())


def _processor() -> str:
    """Name of the processor, which may decide how numbers round."""
    with contextlib.suppress(OSError), Path("/proc/cpuinfo").open(encoding="utf-8") as file:
        for line in file:
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
