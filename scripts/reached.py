"""Reached: which lines of the packages each test runs, and how long it takes; a pytest plugin.

    PYTHONPATH=scripts REACHED=FOLDER python -m pytest -p reached tests

writes FOLDER/TEST_FILE.json for each test file: {test: {"seconds": s, "lines": {file: [numbers]}}}.
Lines that numba compiled are not seen, nor those that another process or thread runs.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = tuple(f"{ROOT / package}{os.sep}" for package in ("twin", "factory", "learn"))
CALLS = 30
"""calls of one function in one test that are followed: later ones seldom run other lines"""


class Reached:
    """Keeps what each test of a file reached, and writes it when the file is through."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._file, self._tests = folder, "", dict[str, dict[str, Any]]()
        self._lines, self._calls = defaultdict[str, set[int]](set), Counter[CodeType]()

    def trace(self, frame: FrameType, event: str, _: Any) -> Any:
        """Python's trace function: follow the packages' functions line by line."""
        code = frame.f_code
        if not code.co_filename.startswith(PACKAGES):
            return None
        self._calls[code] += 1
        if self._calls[code] > CALLS:
            return None
        lines = self._lines[code.co_filename]

        def line(frame: FrameType, event: str, _: Any) -> Any:
            lines.add(frame.f_lineno)
            return line

        return line

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """A test begins: every line counts anew."""
        if nodeid.partition("::")[0] != self._file:
            self._write()
            self._file = nodeid.partition("::")[0]
        self._lines.clear()
        self._calls.clear()
        self._begun = time.perf_counter()
        sys.settrace(self.trace)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """A test is through; the cases of one function are added up."""
        sys.settrace(None)
        kept = self._tests.setdefault(nodeid.partition("[")[0], {"seconds": 0.0, "lines": {}})
        kept["seconds"] += time.perf_counter() - self._begun
        for name, numbers in self._lines.items():
            file = Path(name).relative_to(ROOT).as_posix()
            kept["lines"][file] = sorted(numbers.union(kept["lines"].get(file, ())))

    def pytest_sessionfinish(self) -> None:
        """The last file is through."""
        self._write()

    def _write(self) -> None:
        if self._tests:
            self._folder.mkdir(parents=True, exist_ok=True)
            path = self._folder / (self._file.replace("/", "__") + ".json")
            path.write_text(json.dumps(self._tests))
            self._tests = {}


def pytest_configure(config: Any) -> None:
    """Begin, in every process that runs tests."""
    if "REACHED" in os.environ and (
        hasattr(config, "workerinput") or not config.getoption("numprocesses", None)
    ):
        config.pluginmanager.register(Reached(Path(os.environ["REACHED"])))
