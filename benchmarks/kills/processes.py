"""Processes: those that generate a small store, started by fork so that each begins at once."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path

from benchmarks.faults.writers import digest
from factory.generation.generation import generate
from factory.generation.site import generating
from factory.sampling.recipe import Recipe, make_recipe
from twin.errors import TwinError

SHORT = {
    "mission.duration_h": "uniform(0.03, 0.06)",
    "mission.segment_duration_s": "uniform(30, 90)",
}
"""Missions of two to four minutes"""
DONE, TOLD, CRASHED = 0, 3, 4
"""Exit codes of a process: done, one line of error, a traceback"""
WAIT_S = 300.0
"""[s] after which a process that should have ended is taken for hung"""


def small_recipe(hours: float = 2.0, seed: int = 0) -> Recipe:
    """A recipe of some twenty missions for each hour, which take milliseconds."""
    return make_recipe(hours=hours, seed=seed, changes=SHORT)


def fork(work: Callable[[], object], *, said: Path | None = None) -> int:
    """Do something in a forked process with a session of its own; its number.

    Args:
      said: file for the text of an error.
    """
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
        if said is not None:
            said.write_text(str(error))
    except BaseException:
        traceback.print_exc()
    os._exit(code)


def wait(process: int) -> int:
    """Exit code of a forked process; less than 0 is the signal that ended it."""
    deadline = time.monotonic() + WAIT_S
    while time.monotonic() < deadline:
        found, status = os.waitpid(process, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    raise TimeoutError(f"process {process} did not end in {WAIT_S:g} s")


def children(process: int) -> list[int]:
    """Processes that a process has started and that live."""
    with contextlib.suppress(OSError):
        text = Path(f"/proc/{process}/task/{process}/children").read_text()
        return [int(word) for word in text.split() if lives(int(word))]
    return []


def lives(process: int) -> bool:
    """Whether a process runs or is frozen; not one that has ended and waits."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


def until(condition: Callable[[], bool], seconds: float = WAIT_S) -> bool:
    """Wait for something; False when it does not come."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


def send(process: int, number: signal.Signals) -> None:
    """Send a signal to a process that may be gone."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, number)


def reference(recipe: Recipe, folder: Path) -> tuple[str, float]:
    """Hash of the tree that one process makes without any disturbance, and the time [s] that two
    workers take."""
    wait(fork(lambda: generate(recipe, folder / "one.zarr", workers=1)))
    begun = time.monotonic()
    wait(fork(lambda: generate(recipe, folder / "two.zarr", workers=2)))
    return digest(folder / "one.zarr"), time.monotonic() - begun


def wrong(store: Path, expected: str) -> str | None:
    """What is wrong with a store that should be complete; None when nothing is."""
    if not store.is_dir():
        return "there is no store"
    if digest(store) != expected:
        return "the store has other bytes"
    own = (".", generating(store).name)
    left = [path.name for path in store.parent.iterdir() if path.name.startswith(own)]
    return f"left {', '.join(left)}" if left else None
