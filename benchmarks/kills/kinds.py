"""Kinds: what is done to processes that generate a store. Each says what was lost, if anything."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.faults.injector import compiler
from benchmarks.kills.cluster import Dask
from benchmarks.kills.processes import (
    DONE,
    SHORT,
    TOLD,
    children,
    fork,
    lives,
    reference,
    send,
    small_recipe,
    until,
    wait,
    wrong,
)
from factory.generation.generation import generate
from factory.generation.parts import StorePart, finish, generate_part
from factory.sampling.recipe import Recipe
from twin.records.presence import is_complete

CLOCK = Path(__file__).with_name("clock.c")
BUSY = "another run is generating into"
"""What a run says that finds another one at work"""


@dataclasses.dataclass
class Ground:
    """What all trials of a run share."""

    folder: Path
    random_: random.Random
    recipe: Recipe
    expected: str
    """hash of the tree"""
    seconds: float
    """[s] that an undisturbed run takes"""
    dask: Dask | None = None
    command_s: float | None = None
    """[s] that the command takes with a clock that jumps"""

    @classmethod
    def prepare(cls, folder: Path, seed: int = 0, hours: float = 1.0) -> Ground:
        """Make the store once, undisturbed."""
        recipe = small_recipe(hours)
        return cls(folder, random.Random(seed), recipe, *reference(recipe, folder))

    def moment(self) -> None:
        """Wait for a random moment of a run."""
        time.sleep(self.random_.uniform(0.0, self.seconds))


Trial = Callable[[Ground, Path], str | None]
"""Does something once, for a store at a path in an empty folder; what was lost, None for nothing"""


def parent(ground: Ground, store: Path) -> str | None:
    """Kill the process that hands out the blocks; resume."""
    process = _begin(ground, store)
    ground.moment()
    send(process, signal.SIGKILL)
    wait(process)
    return _resumed(ground, store)


def worker(ground: Ground, store: Path) -> str | None:
    """Kill one of two workers, as a system without memory does; resume."""
    process = _begin(ground, store)
    ground.moment()
    workers = children(process)
    if workers:
        send(ground.random_.choice(workers), signal.SIGKILL)
    code = wait(process)
    if code not in (DONE, TOLD):
        return f"the run ended with {code}"
    return _resumed(ground, store)


def dask_worker(ground: Ground, store: Path) -> str | None:
    """Kill a worker of a cluster while another one joins; the run goes on by itself."""
    dask = ground.dask
    assert dask is not None
    process = fork(lambda: dask.generate(ground.recipe, store))
    ground.moment()
    dask.lose(ground.random_.randrange(len(dask.workers)))
    dask.join()
    code = wait(process)
    return wrong(store, ground.expected) if code == DONE else f"the run ended with {code}"


def frozen_workers(ground: Ground, store: Path) -> str | None:
    """Freeze the workers and kill their parent; they thaw when another run has made the store."""
    process = _begin(ground, store)
    ground.moment()
    workers = children(process)
    for one in workers:
        send(one, signal.SIGSTOP)
    send(process, signal.SIGKILL)
    wait(process)
    try:
        problem = _resumed(ground, store)
        if problem is not None:
            return problem
    finally:
        for one in workers:
            send(one, signal.SIGCONT)
    if not until(lambda: not any(lives(one) for one in workers)):
        return "thawed workers do not end"
    # what one kept after it thawed is of the same recipe, and goes with the next command
    return _resumed(ground, store)


def frozen_run(ground: Ground, store: Path) -> str | None:
    """Freeze a whole run: another one is refused in one line; thawed, the first completes."""
    process = _begin(ground, store)
    ground.moment()
    every = [process, *children(process)]
    for one in every:
        send(one, signal.SIGSTOP)
    done, said = is_complete(store), store.with_name("said")
    second = wait(fork(lambda: generate(ground.recipe, store, resume=True, workers=1), said=said))
    text = said.read_text() if said.exists() else ""
    for one in every:
        send(one, signal.SIGCONT)
    first = wait(process)
    if first != DONE:
        return f"the thawed run ended with {first}"
    began = done or not text  # the first run had no lock yet, or none any more
    if not (second == TOLD and BUSY in text) and not (second == DONE and began):
        return f"the second run ended with {second}: {text}"
    return wrong(store, ground.expected)


def frozen_part(ground: Ground, store: Path) -> str | None:
    """Freeze a part of a job array; the same part runs elsewhere, and the first thaws later."""
    recipe = ground.recipe
    process = fork(lambda: generate_part(recipe, store, StorePart(0, 2)))
    ground.moment()
    send(process, signal.SIGSTOP)
    for part in (StorePart(0, 2), StorePart(1, 2)):
        if (code := wait(fork(lambda p=part: generate_part(recipe, store, p)))) != DONE:  # type: ignore[misc]
            return f"part {part.index} ended with {code}"
    send(process, signal.SIGCONT)
    if (code := wait(process)) != DONE:
        return f"the thawed part ended with {code}"
    code = wait(fork(lambda: finish(store)))
    return wrong(store, ground.expected) if code == DONE else f"`finish` ended with {code}"


def two_starts(ground: Ground, store: Path) -> str | None:
    """Two runs at once, of one recipe or of two: one makes the store, the other says why not."""
    recipes = [ground.recipe, ground.random_.choice([ground.recipe, small_recipe(0.5, seed=1)])]
    said = [store.with_name(f"said-{n}") for n in range(2)]
    runs = [
        fork(lambda r=recipe: generate(r, store, workers=1), said=file)  # type: ignore[misc]
        for recipe, file in zip(recipes, said, strict=True)
    ]
    codes = [wait(run) for run in runs]
    if sorted(codes) != [DONE, TOLD]:
        return f"they ended with {codes}"
    made = recipes[codes.index(DONE)]
    if made is not ground.recipe:
        twin = store.with_name("twin.zarr")
        wait(fork(lambda: generate(made, twin, workers=1)))
        from benchmarks.faults.writers import digest

        return wrong(store, digest(twin))
    return wrong(store, ground.expected)


def clock_jumps(ground: Ground, store: Path) -> str | None:
    """Kill the command while the date jumps by ten years, date its files anyhow, and resume."""
    library = _clock(ground.folder)
    if ground.command_s is None:  # the first one may compile
        for _ in range(2):
            begun = time.monotonic()
            subprocess.run(
                [*_command(ground, store), "--overwrite"], **_clocked(library), check=True
            )
            ground.command_s = time.monotonic() - begun
        if (problem := wrong(store, ground.expected)) is not None:
            return f"without a kill: {problem}"
        shutil.rmtree(store)
    process = subprocess.Popen(_command(ground, store), **_clocked(library))
    time.sleep(ground.random_.uniform(0.0, ground.command_s))
    process.kill()
    process.wait()
    for path in store.parent.rglob("*"):
        date = ground.random_.uniform(0.0, 4e9)
        with contextlib.suppress(FileNotFoundError):  # workers that end tidy up
            os.utime(path, (date, date))
    ended = subprocess.run([*_command(ground, store), "--resume"], **_clocked(library), check=False)
    if ended.returncode:
        return f"the resumed command ended with {ended.returncode}"
    return wrong(store, ground.expected)


KINDS: dict[str, Trial] = {
    one.__name__.replace("_", "-"): one
    for one in (
        *(parent, worker, dask_worker, frozen_workers, frozen_run, frozen_part),
        *(two_starts, clock_jumps),
    )
}


def _begin(ground: Ground, store: Path) -> int:
    return fork(lambda: generate(ground.recipe, store, workers=2))


def _resumed(ground: Ground, store: Path) -> str | None:
    code = wait(fork(lambda: generate(ground.recipe, store, workers=2, resume=True)))
    return wrong(store, ground.expected) if code == DONE else f"the resumed run ended with {code}"


def _command(ground: Ground, store: Path) -> list[str]:
    changes = [f"{name}={text}" for name, text in SHORT.items()]
    words = ["--hours", str(ground.recipe.hours), "--out", str(store), "--set", *changes]
    return [sys.executable, "-m", "factory", "generate", "--workers", "2", *words]


def _clocked(library: Path) -> dict[str, Any]:
    environment = {**os.environ, "LD_PRELOAD": str(library)}
    return {"env": environment, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def _clock(folder: Path) -> Path:
    """The clock that jumps, compiled where it is not yet."""
    library = folder / "clock.so"
    if not library.exists():
        found = compiler()
        assert found is not None, "the clock is a C library: install a C compiler"
        subprocess.run([found, "-shared", "-fPIC", "-o", library, CLOCK, "-ldl"], check=True)
    return library
