"""Settings that every test needs before the libraries read them."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import json
import os
from pathlib import Path

import hypothesis
import pytest

# Two processes test and start others: were each thread of a matrix library to wait for its like on
# a processor that another process has, small matrices would take ten times the time and more.
# Libraries read it when they are imported; the test processes, and what they start, inherit it.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# Hundreds of commands are started, each of which would compile the packages' Python again where
# the environment says that nothing of it is kept. An empty word is none.
os.environ["PYTHONDONTWRITEBYTECODE"] = ""

from twin.extras import preload_triton


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _egl_is_there() -> bool:
    # PyOpenGL needs both, and takes either library for the second.
    return _loads("libEGL.so.1") and (_loads("libOpenGL.so.0") or _loads("libGL.so.1"))


# MuJoCo and dm_control choose how to draw when they are imported. Without a screen their own choice
# tries GLFW first and warns; where nothing can draw, the tests that draw skip themselves.
os.environ.setdefault("MUJOCO_GL", "egl" if _egl_is_there() else "disable")

# Some tests import dm_control, which opens OpenGL, before anything of ours does.
preload_triton()

# It makes a folder in the home when it is first imported, and fails where two processes do so at
# the same moment.
for _ in range(2):
    with contextlib.suppress(ImportError, FileExistsError):
        importlib.import_module("dbdreader")

# Plots go to files.
os.environ.setdefault("MPLBACKEND", "Agg")

# No deadline: the first call of a compiled function takes seconds. In CI the examples are always
# the same, so that a red run means a changed program.
hypothesis.settings.register_profile("here", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "here")


@pytest.fixture(autouse=True)
def own_variables():
    """A test may declare variables, as an import of a payload does: afterwards they are gone."""
    from twin.records.schema import VARIABLES

    before = dict(VARIABLES)
    yield
    VARIABLES.clear()
    VARIABLES.update(before)


SLOW: dict[str, float] = json.loads(Path(__file__).with_name("slow.json").read_text())
"""[s] of each file that takes long, as `scripts/durations.py` found it"""


PARTS: dict[str, list[str]] = json.loads(Path(__file__).with_name("parts.json").read_text())
"""Files and folders that `make test-docs` and `make test-release` run; `make test` has the rest"""
CODE = "code"
"""The part that is the rest"""


def _place(path: Path) -> str:
    root = Path(__file__).resolve().parents[1]
    return path.relative_to(root).as_posix() if path.is_relative_to(root) else ""


def _seconds(path: Path) -> float:
    return SLOW.get(_place(path), 0.0)


def _part(path: Path) -> str | None:
    """The part of a file or of a whole folder; None for a folder of several."""
    place = f"{_place(path)}/"
    for part, places in PARTS.items():
        if any(place.startswith(f"{one}/") for one in places):
            return part
    return CODE if path.is_file() else None


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help="without the files of tests/slow.json")
    parser.addoption("--part", choices=(CODE, *PARTS), help="of tests/parts.json [default: all]")
    parser.addoption("--backwards", action="store_true", help="the last test first")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skip the import of files that a run leaves out; None leaves the others to pytest."""
    if config.getoption("--quick", False) and _seconds(collection_path):
        return True
    part, own = config.getoption("--part", None), _part(collection_path)
    return True if part is not None and own not in (None, part) else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The longest files begin, so that no process has one left when the others have ended.

    In a single process the tests run in the order that was asked for. No test may need one before
    it: `--backwards` shows it.
    """
    if hasattr(config, "workerinput"):
        items.sort(key=lambda item: -_seconds(item.path))
    if config.getoption("--backwards"):
        items.reverse()


def pytest_collection_finish() -> None:
    """Thousands of collected tests stay to the end: whoever looks for garbage passes them over."""
    gc.collect()
    gc.freeze()
