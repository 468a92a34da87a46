"""Histories: processes that write are killed at random moments; nothing is lost, nothing is half.

    python -m benchmarks.histories [KIND ...] [--histories 1000] [--seed 0]

A history of `factory generate` has one to three killed runs and spoilt files of the unfinished
store, then a run to the end. Kinds of kill: the parent, one of two workers, three commands with
--shard at once, a worker of a dask cluster which another one replaces. The store must have, byte
for byte, the tree that an undisturbed process makes, with nothing beside it, and `factory verify`
must name the file of a flipped bit. A killed `import` leaves the old store or the new one whole, a
killed pass of `watch` what the next one completes.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from clusters import dask_cluster  # type: ignore[import-not-found]  # noqa: E402
from clusters import worker as dask_worker  # noqa: E402

import factory  # noqa: E402
from factory.generation import StorePart, finish, generate, generate_part  # noqa: E402
from factory.sampling import Recipe, make_recipe  # noqa: E402
from factory.store_check import check_files  # noqa: E402
from twin.errors import TwinError  # noqa: E402
from twin.records.presence import generating  # noqa: E402

MEMORY = Path("/dev/shm")
"""Where stores are made if it is there: nothing then waits for a disk"""
SHORT = {
    "mission.duration_h": "uniform(0.03, 0.06)",
    "mission.segment_duration_s": "uniform(30, 90)",
}
HOURS = 1.0
"""[h] of a store, in missions of two to four minutes"""
DONE, TOLD, CRASHED = 0, 3, 4
"""Exit codes of a process: done, one line of error, a traceback"""
WAIT_S = 300.0  # after which a process that should have ended is taken for hung
PARTS, MOST_KILLS = [StorePart(index, 3) for index in range(3)], 3
KEPT = ("recipe.json", "array.json", "lock")
"""Files of an unfinished store that are not spoilt: without them it is another one"""


def fork(work: Callable[[], object]) -> int:
    """Do something in a forked process with a session of its own; its number."""
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
    """Exit code of a forked process, killed first or not; below 0 is the signal that ended it."""
    if kill:
        os.kill(process, signal.SIGKILL)  # one that has ended is there until it is waited for
    deadline = time.monotonic() + WAIT_S
    while time.monotonic() < deadline:
        found, status = os.waitpid(process, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    raise TimeoutError(f"process {process} did not end in {WAIT_S:g} s")


def digest(folder: Path, pattern: str = "*") -> str:
    """SHA-256 over names and bytes of the files below a folder."""
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
    """hash of the tree"""
    seconds: float
    """[s] that an undisturbed run takes"""
    address: str = ""
    workers: list[subprocess.Popen[bytes]] = dataclasses.field(default_factory=list)
    """of the dask scheduler at the address"""

    @classmethod
    def prepare(cls, folder: Path, seed: int = 0) -> Ground:
        """Make the store undisturbed: by one process, and by two whose time is taken."""
        recipe = make_recipe(hours=HOURS, changes=SHORT)
        assert wait(fork(lambda: generate(recipe, folder / "one.zarr", workers=1))) == DONE
        begun = time.monotonic()
        assert wait(fork(lambda: generate(recipe, folder / "two.zarr", workers=2))) == DONE
        seconds = time.monotonic() - begun
        return cls(folder, random.Random(seed), recipe, digest(folder / "one.zarr"), seconds)

    def begin(self, work: Callable[[], object], seconds: float | None = None) -> int:
        """Start something, up to a random moment of it; its process."""
        process = fork(work)
        time.sleep(self.draw.uniform(0.0, seconds or self.seconds))
        return process


def harm(ground: Ground, kind: str, store: Path) -> int:
    """Start what makes a store and kill it; an exit code above 0 is a loss."""
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
        with contextlib.suppress(OSError, IndexError):  # it may have ended
            text = Path(f"/proc/{process}/task/{process}/children").read_text()
            os.kill(int(text.split()[0]), signal.SIGKILL)
    code = wait(process, kill=kind == "parent")
    return DONE if code == TOLD else code


def history(ground: Ground, kind: str, store: Path) -> str | None:
    """Kill, spoil, resume, verify; what was lost, None for nothing."""
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
    """Cut or remove a file of an unfinished store, every second time."""
    place = generating(store)
    assert isinstance(place, Path)
    # os.walk passes over folders that a worker without its parent removes meanwhile
    walked = ((Path(folder), names) for folder, _, names in os.walk(place))
    found = sorted(at / name for at, names in walked for name in names if name not in KEPT)
    if not found or ground.draw.random() < 0.5:
        return
    path = ground.draw.choice(found)
    with contextlib.suppress(FileNotFoundError):  # a worker without its parent may still work
        if ground.draw.random() < 0.5:
            path.unlink()
        else:
            os.truncate(path, path.stat().st_size // 2)


def fault_of(ground: Ground, store: Path) -> str | None:
    """Name the fault of a store that should be complete; None when it has none."""
    if not store.is_dir():
        return "there is no store"
    if digest(store) != ground.expected:
        return "the store has other bytes"
    names = (".", generating(store).name)
    left = [path.name for path in store.parent.iterdir() if path.name.startswith(names)]
    if left:
        return f"left {', '.join(left)}"
    path = ground.draw.choice(sorted(path for path in store.rglob("*") if path.is_file()))
    data = bytearray(path.read_bytes())
    data[ground.draw.randrange(len(data))] ^= 1 << ground.draw.randrange(8)
    path.write_bytes(data)
    name = path.relative_to(store).as_posix()
    found = any(problem.startswith(f"{name} is ") for problem in check_files(store).problems)
    return None if found else f"verify does not find a flipped bit of {name}"


def kill_runs(ground: Ground, kind: str, times: int) -> list[str]:
    """Losses of so many histories of `factory generate`."""
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
    """Kill imports that are to replace a store; attributes have the date, so that values count."""
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

    assert wait(fork(reading(old, 4.0))) == DONE
    begun = time.monotonic()
    assert wait(fork(reading(new, 2.0))) == DONE
    seconds, whole = time.monotonic() - begun, [digest(one, "c/**/*") for one in (old, new)]
    for number in range(times):
        assert wait(fork(reading(store, 4.0))) == DONE
        wait(ground.begin(reading(store, 2.0), seconds), kill=True)
        if values() not in whole:
            lost.append(f"import {number}: neither the old store nor the new one")
        if wait(fork(reading(store, 2.0))) != DONE or values() != whole[1]:
            lost.append(f"import {number}: the next import does not make the store")
        lost += [f"import {number}: left {path.name}" for path in place.glob(".*")]
    return lost


def kill_passes(ground: Ground, kind: str, times: int) -> list[str]:
    """Losses of killed passes of `twin watch`."""
    from benchmarks.watch_passes import kills

    found: dict[str, Any] = kills(times, ground.draw.randrange(2**31), ground.folder / kind)
    return list(found["others"])


KINDS: dict[str, Callable[[Ground, str, int], list[str]]] = {
    **dict.fromkeys(("parent", "worker", "parts", "dask"), kill_runs),
    "import": kill_imports,
    "watch": kill_passes,
}


def main() -> int:
    """Print the table; exit code 1 when something was lost."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kinds", nargs="*", choices=[*KINDS, []], metavar="KIND")
    parser.add_argument("--histories", type=int, default=1000, help="of all kinds together")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    options = parser.parse_args()
    kinds = options.kinds or [kind for kind, make in KINDS.items() if make is kill_runs]
    every: list[str] = []
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as folder:
        ground = Ground.prepare(Path(folder), options.seed)
        for number, kind in enumerate(kinds):
            begun, times = time.monotonic(), (options.histories + number) // len(kinds)
            lost = KINDS[kind](ground, kind, times)
            every += lost
            seconds = time.monotonic() - begun
            print(f"{kind}: {times} histories, {len(lost)} lost, {seconds:.0f} s", flush=True)
    print("\n".join(every))
    return 1 if every else 0


if __name__ == "__main__":
    raise SystemExit(main())
