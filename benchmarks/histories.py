"""Histories of killed writers: processes are killed at random moments, and no data may be lost.

    python -m benchmarks.histories [KIND ...] [--histories 1000] [--seed 0]

A history of `factory generate` has one to three killed runs, damaged files of the unfinished store,
and a final run to the end. The killed process is the parent, one of two workers, three --shard
commands at once, or a worker of a dask cluster, which is replaced by another. The store must then
have the same bytes as an undisturbed run's, and no further files. `factory verify` must name each
damaged file (`damage`: of finished stores). A killed `import` must leave the old or new store
whole, a killed pass of `watch` a state that the next pass completes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal

from benchmarks import command
from benchmarks.processes import DONE, ROOT, TOLD, done, fork, wait

sys.path.insert(0, str(ROOT / "tests"))

from clusters import dask_cluster
from clusters import worker as dask_worker

import factory
from factory.generation import StorePart, finish, generate, generate_part
from factory.sampling import Recipe, make_recipe
from factory.store_check import check_files
from twin.records.presence import generating

MEMORY = Path("/dev/shm")
"""Folder of the stores, if it exists: no disk then delays them"""
SHORT = {
    "mission.duration_h": "uniform(0.03, 0.06)",
    "mission.segment_duration_s": "uniform(30, 90)",
}
HOURS = 1.0
"""[h] Length of a store, in missions of two to four minutes"""
PARTS, MOST_KILLS = [StorePart(index, 3) for index in range(3)], 3
KEPT = ("recipe.json", "array.json", "lock")
"""Files of an unfinished store that are never damaged: they define the store"""


def digest(folder: Path, pattern: str = "*") -> str:
    """SHA-256 over names and bytes of the files in a folder."""
    found = hashlib.sha256()
    for path in sorted(path for path in folder.rglob(pattern) if path.is_file()):
        found.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return found.hexdigest()


@dataclasses.dataclass
class Ground:
    """Recipe, folder and expected hash that all histories share."""

    folder: Path
    draw: random.Random
    recipe: Recipe
    expected: str
    """Hash of the undisturbed store"""
    seconds: float
    """[s] Duration of an undisturbed run"""
    address: str = ""
    workers: list[subprocess.Popen[bytes]] = dataclasses.field(default_factory=list)
    """Workers of the dask scheduler at the address"""

    @classmethod
    def prepare(cls, folder: Path, seed: int = 0) -> Ground:
        """Make the store undisturbed by one process, then by two processes, which are timed."""
        recipe = make_recipe(hours=HOURS, changes=SHORT)
        assert done(lambda: generate(recipe, folder / "one.zarr", workers=1))
        begun = time.monotonic()
        assert done(lambda: generate(recipe, folder / "two.zarr", workers=2))
        seconds = time.monotonic() - begun
        return cls(folder, random.Random(seed), recipe, digest(folder / "one.zarr"), seconds)

    def begin(self, work: Callable[[], object], seconds: float | None = None) -> int:
        """Start some work, wait until a random moment, and return its process."""
        process = fork(work)
        time.sleep(self.draw.uniform(0.0, seconds or self.seconds))
        return process


def harm(ground: Ground, kind: str, store: Path) -> int:
    """Start a writer of a store and kill it; an exit code above 0 is a loss."""
    recipe = ground.recipe
    if kind == "parts":
        every = [fork(partial(generate_part, recipe, store, part)) for part in PARTS[1:]]
        every.append(ground.begin(partial(generate_part, recipe, store, PARTS[0])))
        return max(wait(one, kill=True) for one in every)
    if kind == "dask":
        with_cluster = partial(factory.generate, store, scheduler=ground.address)
        process = ground.begin(partial(with_cluster, hours=HOURS, changes=SHORT, resume=True))
        lost = ground.workers.pop(ground.draw.randrange(len(ground.workers)))
        lost.kill()
        lost.wait()
        ground.workers.append(dask_worker(ground.address))
        return wait(process)
    process = ground.begin(partial(generate, recipe, store, workers=2, resume=True))
    if kind == "worker":
        with contextlib.suppress(OSError, IndexError):  # the process may have ended
            text = Path(f"/proc/{process}/task/{process}/children").read_text()
            os.kill(int(text.split()[0]), signal.SIGKILL)
    code = wait(process, kill=kind == "parent")
    return DONE if code == TOLD else code


def history(ground: Ground, kind: str, store: Path) -> str | None:
    """Kill, damage, resume and verify; return the loss, None for no loss."""
    for _ in range(ground.draw.randint(1, MOST_KILLS)):
        code = harm(ground, kind, store)
        if code > 0:
            return f"a run ended with {code}"
        _spoil(ground, store)

    def complete() -> None:
        if kind != "parts":
            generate(ground.recipe, store, workers=2, resume=True)
            return
        for part in PARTS:
            generate_part(ground.recipe, store, part)
        finish(store)

    code = wait(fork(complete))
    return f"the last run ended with {code}" if code != DONE else fault_of(ground, store)


def _spoil(ground: Ground, store: Path) -> None:
    """Cut or remove a file of an unfinished store, in half of the calls."""
    place = generating(store)
    # os.walk ignores folders that an orphaned worker removes meanwhile
    walked = ((Path(folder), names) for folder, _, names in os.walk(place))
    found = sorted(at / name for at, names in walked for name in names if name not in KEPT)
    if not found or ground.draw.random() < 0.5:
        return
    path = ground.draw.choice(found)
    with contextlib.suppress(FileNotFoundError):  # an orphaned worker may still run
        if ground.draw.random() < 0.5:
            path.unlink()
        else:
            os.truncate(path, path.stat().st_size // 2)


def fault_of(ground: Ground, store: Path) -> str | None:
    """Name the fault of a store that should be complete; None for a sound store."""
    if not store.is_dir():
        return "there is no store"
    if digest(store) != ground.expected:
        return "the store has other bytes"
    names = (".", generating(store).name)
    left = [path.name for path in store.parent.iterdir() if path.name.startswith(names)]
    if left:
        return f"left {', '.join(left)}"
    return unnoticed(ground, store)


def unnoticed(ground: Ground, store: Path) -> str | None:
    """Damage one file of a store; return the damage if `factory verify` does not name the file."""
    every = sorted(path for path in store.rglob("*") if path.is_file())
    path, other = ground.draw.sample(every, 2)
    data = path.read_bytes()
    place, bit = ground.draw.randrange(len(data)), 1 << ground.draw.randrange(8)
    made: dict[str, bytes | None] = {
        "flipped bit": data[:place] + bytes([data[place] ^ bit]) + data[place + 1 :],
        "cut": data[:place],
        "zeros": data[:place] + bytes(len(data) - place),
        "further bytes": data + ground.draw.randbytes(bit),
        "another file's bytes": other.read_bytes(),
        "removal": None,
    }
    name, damaged = ground.draw.choice([one for one in made.items() if one[1] != data])
    path.unlink()
    if damaged is not None:
        path.write_bytes(damaged)
    file = path.relative_to(store).as_posix()
    found = any(problem.startswith(f"{file} is ") for problem in check_files(store).problems)
    return None if found else f"verify does not find this damage of {file}: {name}"


def kill_runs(ground: Ground, kind: str, times: int) -> list[str]:
    """Losses in `times` histories of `factory generate`."""
    lost = []
    with contextlib.ExitStack() as stack:
        if kind == "dask":
            ground.address = stack.enter_context(dask_cluster())
            ground.workers = [dask_worker(ground.address) for _ in range(2)]
        for number in range(times):
            with tempfile.TemporaryDirectory(dir=ground.folder) as folder:
                problem = history(ground, kind, Path(folder) / "missions.zarr")
            if problem is not None:
                lost.append(f"{kind} {number}: {problem}")
        for one in ground.workers:
            one.kill()
            one.wait()
    return lost


def kill_imports(ground: Ground, kind: str, times: int) -> list[str]:
    """Kill imports that replace a store; only values are compared, since attributes have dates."""
    from factory import samples

    place, lost = ground.folder / kind, []
    place.mkdir()
    samples.write("slocum", place / "logs", samples.Flight(dives=2, surface=600.0, swing=1.0))
    old, new, store = place / "old.zarr", place / "new.zarr", place / "store.zarr"

    def reading(out: Path, period: float) -> Callable[[], object]:
        read = partial(factory.import_logs, "slocum", [place / "logs"], out)
        return partial(read, period=period, overwrite=True)

    def values() -> str | None:
        return None if check_files(store).problems else digest(store, "c/**/*")

    assert done(reading(old, 4.0))
    begun = time.monotonic()
    assert done(reading(new, 2.0))
    seconds, whole = time.monotonic() - begun, [digest(one, "c/**/*") for one in (old, new)]
    for number in range(times):
        assert done(reading(store, 4.0))
        wait(ground.begin(reading(store, 2.0), seconds), kill=True)
        if values() not in whole:
            lost.append(f"import {number}: neither the old store nor the new one")
        if not done(reading(store, 2.0)) or values() != whole[1]:
            lost.append(f"import {number}: the next import does not make the store")
        lost += [f"import {number}: left {path.name}" for path in place.glob(".*")]
    return lost


def kill_passes(ground: Ground, kind: str, times: int) -> list[str]:
    """Losses in killed passes of `twin watch`."""
    from benchmarks.watch_passes import killed

    found: dict[str, Any] = killed(times, ground.draw.randrange(2**31), ground.folder / kind)
    return list(found["others"])


def damage_stores(ground: Ground, kind: str, times: int) -> list[str]:
    """Damages of finished stores that `factory verify` does not find."""
    lost = []
    for _ in range(times):
        shutil.copytree(ground.folder / "one.zarr", ground.folder / kind)
        lost.append(unnoticed(ground, ground.folder / kind))
        shutil.rmtree(ground.folder / kind)
    return [one for one in lost if one is not None]


KINDS: dict[str, Callable[[Ground, str, int], list[str]]] = {
    **dict.fromkeys(("parent", "worker", "parts", "dask"), kill_runs),
    "import": kill_imports,
    "watch": kill_passes,
    "damage": damage_stores,
}


Kind = Literal["parent", "worker", "parts", "dask", "import", "watch", "damage"]


def main(
    kinds: command.Positional[tuple[Kind, ...]] = (), *, histories: int = 1000, seed: int = 0
) -> int:
    """Print a line for each kind of kill, and the losses; exit code 1 if there are any.

    Args:
      kinds: kinds of kills; default those of `factory generate`.
      histories: number of histories of all kinds together.
      seed: seed of the random moments.
    """
    chosen = kinds or tuple(kind for kind, make in KINDS.items() if make is kill_runs)
    every: list[str] = []
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as folder:
        ground = Ground.prepare(Path(folder), seed)
        for number, kind in enumerate(chosen):
            begun, times = time.monotonic(), (histories + number) // len(chosen)
            lost = KINDS[kind](ground, kind, times)
            every += lost
            seconds = time.monotonic() - begun
            print(f"{kind}: {times} histories, {len(lost)} lost, {seconds:.0f} s", flush=True)
    print("\n".join(every))
    return 1 if every else 0


if __name__ == "__main__":
    sys.exit(command.run(main))
