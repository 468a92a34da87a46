"""One hash: a store made in every way, also after kills, has the same bytes.

    python -m benchmarks.one_hash [--hours 1] [--kills 3]

Ways: 1 process, 2 processes, 8 commands with --shard at once, and a dask cluster of 3 workers of
which one is killed while another joins. Then each of them again with its processes killed so often
before it may complete. The cluster needs `pip install "glider-twin[cluster]"`. Printed is for each
way the SHA-256 over names and bytes of the whole tree.
"""

from __future__ import annotations

import argparse
import random
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.faults.__main__ import MEMORY
from benchmarks.faults.writers import digest
from benchmarks.kills.cluster import Dask, dask_cluster
from benchmarks.kills.processes import DONE, children, fork, reference, send, small_recipe, wait
from factory.generation.generation import generate
from factory.generation.parts import StorePart, finish, generate_part
from factory.sampling.recipe import Recipe
from twin.cli.text_table import format_table
from twin.records.presence import is_complete

PARTS = 8
CLUSTER = 3
Start = Callable[[], list[int]]
"""Starts the processes of a way; their numbers"""


class Ways:
    """Every way to make the store of a recipe."""

    def __init__(self, recipe: Recipe, folder: Path, seconds: float, seed: int = 0) -> None:
        """`seconds` is what an undisturbed run takes [s]."""
        self.recipe, self.folder, self.seconds = recipe, folder, seconds
        self.random_ = random.Random(seed)

    def processes(self, count: int, kills: int) -> str:
        """`factory generate` with so many workers."""
        store = self.folder / f"{count}-processes-{kills}.zarr"

        def start() -> list[int]:
            return [fork(lambda: generate(self.recipe, store, workers=count, resume=True))]

        return self._made(start, store, kills)

    def parts(self, kills: int) -> str:
        """Eight `factory generate --shard i/8` at once, then `factory finish`."""
        store = self.folder / f"parts-{kills}.zarr"

        def start() -> list[int]:
            return [
                fork(lambda i=i: generate_part(self.recipe, store, StorePart(i, PARTS)))  # type: ignore[misc]
                for i in range(PARTS)
            ]

        self._run(start, store, kills)
        assert wait(fork(lambda: finish(store))) == DONE
        return digest(store)

    def cluster(self, kills: int) -> str:
        """`factory generate --scheduler` while a worker of three is lost and another one joins."""
        store = self.folder / f"cluster-{kills}.zarr"
        with dask_cluster(CLUSTER) as dask:

            def start() -> list[int]:
                return [fork(lambda: dask.generate(self.recipe, store, resume=True))]

            return self._made(start, store, kills, dask)

    def _made(self, start: Start, store: Path, kills: int, dask: Dask | None = None) -> str:
        self._run(start, store, kills, dask)
        return digest(store)

    def _run(self, start: Start, store: Path, kills: int, dask: Dask | None = None) -> None:
        """Kill so many starts at random moments, then let one complete."""
        for _ in range(kills):
            running = start()
            time.sleep(self.random_.uniform(0.2, 0.9) * self.seconds)
            for process in running:
                for one in (process, *children(process)):
                    send(one, signal.SIGKILL)
                wait(process)
            if is_complete(store):
                break
        running = start()
        if dask is not None:
            time.sleep(0.5 * self.seconds)
            dask.lose(self.random_.randrange(len(dask.workers)))
            dask.join()
        codes = [wait(process) for process in running]
        assert set(codes) == {DONE}, f"processes ended with {codes}"


def hashes(folder: Path, hours: float, kills: int) -> list[tuple[str, str]]:
    """Each way, in words, and the hash of its tree."""
    recipe = small_recipe(hours)
    whole, seconds = reference(recipe, folder)
    ways = Ways(recipe, folder, seconds)
    found = [("1 process", whole)]
    for again in (0, kills) if kills else (0,):
        after = f", after {again} kills" if again else ""
        if again:
            found.append((f"1 process{after}", ways.processes(1, again)))
        found.append((f"2 processes{after}", ways.processes(2, again)))
        found.append((f"{PARTS} shards at once{after}", ways.parts(again)))
        name = f"dask cluster of {CLUSTER}, one lost, one joining{after}"
        found.append((name, ways.cluster(again)))
    return found


def main() -> int:
    """Print the hashes; exit code 1 when there is more than one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=1.0, help="simulated, of short missions")
    parser.add_argument("--kills", type=int, default=3, help="before each way may complete")
    options = parser.parse_args()
    place = MEMORY if MEMORY.is_dir() else None
    with tempfile.TemporaryDirectory(dir=place) as folder:
        found = hashes(Path(folder), options.hours, options.kills)
    print(format_table([{"way": way, "SHA-256 of the tree": value} for way, value in found]))
    count = len({value for _, value in found})
    print(f"{len(found)} ways, {count} hash{'es' if count > 1 else ''}")
    return 0 if count == 1 else 1


if __name__ == "__main__":
    raise SystemExit(main())
