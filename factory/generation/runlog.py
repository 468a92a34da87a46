"""Run log: which machine made a store, when and by which command, beside the store.

None of it is in the store, whose bytes are the same wherever it is made. `NAME.log` has one line of
JSON for each run. Objects of an object storage cannot grow: there `NAME.log/` has one for each run.
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
from twin.records.object_files import files_at
from twin.records.store_path import StorePath


def log_of(store: StorePath) -> StorePath:
    """The log of a store."""
    return store.with_name(store.name + ".log")


def note(store: StorePath, recipe: Recipe, command: str) -> None:
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
    line, log = json.dumps(entry) + "\n", log_of(store)
    if isinstance(log, Path):
        with log.open("a", encoding="utf-8") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
    else:
        name = f"{entry['time']}-{entry['host']}-{os.getpid()}.json"
        files_at(log).write(name, line.encode())


def _processor() -> str:
    """Name of the processor, which may decide how numbers round."""
    with contextlib.suppress(OSError), Path("/proc/cpuinfo").open(encoding="utf-8") as file:
        for line in file:
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
