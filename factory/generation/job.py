"""Job: a recipe and the place of its store, which every process that works for it has.

Beside the store `NAME` lies the folder `NAME.generating`. It holds, for the recipe's hash, the
recipe itself, a marker of every finished shard, and `tree`, which becomes the store in one step. So
a store is under its name when it is complete and not before, and what a run of another recipe
leaves can never get into it.

An object storage has no such step. There the tree grows under the store's own name, and the store
is one when its `zarr.json` appears, which is written last. Locks it has none either, and needs none
for runs of one recipe, which write the same bytes. Those of two recipes must not meet there: the
first one that was begun keeps the name.

Layout: which missions make a shard; by their number and how many fly together.
Marker: record of a finished shard, so that it is neither repeated nor mistaken.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import functools
import hashlib
import json
import math
import os
import re
import shutil
import socket
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.generation.bookkeeping import FailedAttempt
from factory.sampling.recipe import Recipe, read_recipe
from twin.bounded import FREE_BYTES
from twin.errors import StoreError
from twin.records.presence import RECIPE, begun, generating
from twin.records.storage.disk import sweep
from twin.records.storage.store_path import Files, FileSum, StorePath, Url, files_at

DIGITS = 16
"""Of a recipe's hash, in names of folders"""
STAGING = "staging-"
"""Begins the names of folders in which processes make shards that are not whole yet"""
MARKER = re.compile(r"done/(\d{7,12})-(\d{7,12})")
"""Key of a shard's marker: its first and last mission"""
DIGEST = 32
"""[byte] of a marker's SHA-256, with which its file begins"""
_READY: dict[str, Recipe] = {}
"""Recipes of this process by their hashes: each is planned and compiled once. Forked workers have
those of their parent."""
_MOST_READY = 4
_HELD: set[int] = set()
"""Open files that hold locks"""
MOST_IN_SHARD = 64
"""Missions in a shard: 48 h of preset paper, a MB per signal, some seconds of work"""
SHARDS_PER_STORE = 8
"""Fewest shards, if there are enough missions: processes that share a store end together"""
SHARDS_ABREAST = 4
"""Fewest shards of the batched engine: of 64 missions each takes a twentieth of one alone"""
MOST_SHARDS = 192
"""Shards of a large store grow instead: a million missions stay below 20 000 files"""
ROWS = 65_536
"""Missions in a chunk of an array that holds one value of each mission"""


class Layout(NamedTuple):
    """The shards of a store of `missions`."""

    missions: int
    abreast: int = 1
    """missions that fly together"""

    @property
    def shard_missions(self) -> int:
        """Missions in each shard; the last one may have fewer."""
        least = SHARDS_PER_STORE if self.abreast == 1 else SHARDS_ABREAST
        usual = min(MOST_IN_SHARD, -(-self.missions // least))
        return usual * -(-self.missions // (usual * MOST_SHARDS))

    @property
    def row_missions(self) -> int:
        """Missions in each chunk of an array over missions: whole shards."""
        shard = self.shard_missions
        return min(self.missions, shard * max(1, ROWS // shard))

    @property
    def shards(self) -> range:
        """Numbers of all shards."""
        return range(-(-self.missions // self.shard_missions))

    def missions_of(self, shard: int) -> range:
        """Missions of one shard."""
        size = self.shard_missions
        return range(shard * size, min((shard + 1) * size, self.missions))


class Job:
    """A recipe and the place of its store.

    It travels to other processes as text, so that whatever a recipe holds, a sensor of a plugin
    too, is made there by the same registered kinds. The text is read by the task that needs it: a
    worker that cannot read it can say so then, and would end if it could not even take the task.
    """

    def __init__(self, recipe: Recipe | str, store: StorePath, digest: str = ""):
        """`recipe` may be its text, as `document` gives it, and then has this `digest`."""
        self.store = store
        if isinstance(recipe, str):
            self._text, self.digest = recipe, digest
        else:
            self.recipe, self.digest = recipe, recipe.digest
            _keep(self.digest, recipe)

    def __reduce__(self) -> tuple[Any, ...]:
        return Job, (self._text, self.store, self.digest)

    @functools.cached_property
    def _text(self) -> str:
        return json.dumps(self.recipe.document())

    @functools.cached_property
    def recipe(self) -> Recipe:
        """Recipe of the store.

        Raises:
          StoreError: libraries have other versions here, so that it would make other bytes.
        """
        if self.digest not in _READY:
            _keep(self.digest, read_recipe(json.loads(self._text)))
        return _READY[self.digest]

    @functools.cached_property
    def layout(self) -> Layout:
        """Its shards."""
        return Layout(len(self.recipe.plan), self.recipe.abreast)

    @property
    def local(self) -> bool:
        """Whether the store is a folder of this machine."""
        return isinstance(self.store, Path)

    @property
    def folder(self) -> StorePath:
        """All that runs of this recipe keep."""
        return generating(self.store) / self.digest[:DIGITS]

    @functools.cached_property
    def files(self) -> Files:
        """The recipe and markers."""
        return files_at(self.folder)

    @functools.cached_property
    def tree(self) -> Files:
        """Files that become the store."""
        return self.files.below("tree") if self.local else files_at(self.store)

    def marker(self, shard: int) -> str:
        """Key of the marker of a shard, in `files`."""
        missions = self.layout.missions_of(shard)
        return f"done/{missions[0]:07d}-{missions[-1]:07d}"

    @contextlib.contextmanager
    def staging(self) -> Iterator[Path]:
        """A folder of this process on this machine, which goes away in the end."""
        if isinstance(self.folder, Path):
            place = self.folder / f"{STAGING}{socket.gethostname()}-{os.getpid()}"
            shutil.rmtree(place, ignore_errors=True)  # of a process with the same number
        else:
            place = Path(tempfile.mkdtemp(prefix="glider-twin-")) / "shard"
        try:
            yield place
        finally:
            shutil.rmtree(place if self.local else place.parent, ignore_errors=True)

    def begin(self) -> None:
        """Make the folder, with the recipe in it; does nothing where it is.

        Raises:
          StoreError: another recipe was begun at the same moment, where there are no locks.
        """
        if self.files.exists(RECIPE):
            return
        self.files.write(RECIPE, json.dumps(self.recipe.document(), indent=1).encode(), safe=True)
        others = [] if self.local else [p for p in begun(self.store) if p != self.folder]
        if others:
            self.files.remove(RECIPE)
            raise StoreError(
                f"{others[0]} belongs to a run of another recipe: use another --out, or remove "
                f"everything below {generating(self.store)} and {self.store}"
            )

    def sweep(self) -> None:
        """Remove what processes that are gone left half-written; nobody else works here."""
        if isinstance(self.folder, Path):
            for left in self.folder.glob(f"{STAGING}*"):
                shutil.rmtree(left, ignore_errors=True)
            sweep(self.folder)

    def clear(self) -> None:
        """Remove what this recipe's runs keep, and the folder when nothing else is in it.

        Nobody else works here.
        """
        self.files.remove_all()
        outer = generating(self.store)
        if isinstance(outer, Path):
            with contextlib.suppress(OSError):
                for left in outer.iterdir():  # of a run that was killed as it began
                    if left.is_dir() and not (left / RECIPE).exists():
                        shutil.rmtree(left, ignore_errors=True)
                (outer / "lock").unlink(missing_ok=True)
                outer.rmdir()


def _keep(digest: str, recipe: Recipe) -> None:
    """Have a recipe ready for the next job of this process."""
    while len(_READY) >= _MOST_READY:
        del _READY[next(iter(_READY))]
    _READY[digest] = recipe


def missions_kept(folder: StorePath) -> int:
    """Missions of the finished shards of a run that was begun, by the names of their markers."""
    found = map(MARKER.fullmatch, files_at(folder).all_keys())
    return sum(max(0, int(one[2]) - int(one[1]) + 1) for one in found if one)


@contextlib.contextmanager
def locked(store: StorePath, *, shared: bool = False) -> Iterator[None]:
    """Hold the working folder of a store for this process, alone or with others that share it.

    An object storage has no locks.

    Raises:
      StoreError: another run is working there.
    """
    folder = generating(store)
    if isinstance(folder, Url):
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    _HELD.add(descriptor)
    try:
        try:
            fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StoreError(
                f"another run is generating into {store}; wait for it or use another --out"
            ) from None
        yield
    finally:
        _HELD.discard(descriptor)
        os.close(descriptor)


def close_locks() -> None:
    """Close the locks that a forked process has of its parent: only the parent may hold them."""
    while _HELD:
        os.close(_HELD.pop())


@dataclasses.dataclass(frozen=True, kw_only=True)
class Marker:
    """Record of a finished shard."""

    number: int
    recipe: str
    """hash of the recipe"""
    files: dict[str, FileSum]
    """by key in the tree"""
    failures: list[FailedAttempt]
    """every attempt that failed and was replaced"""
    versions: Mapping[str, str]
    """of what can change a bit of a result"""
    rows: dict[str, NDArray[Any]]
    """values of each mission, as `bookkeeping.rows` gives them"""

    def to_bytes(self) -> bytes:
        """As it is kept: SHA-256 of the rest, a line of JSON, the rows one after the other."""
        table: dict[str, Any] = {**vars(self)}
        table["rows"] = {name: (one.dtype.str, one.shape) for name, one in self.rows.items()}
        text = json.dumps(table).encode() + b"\n"
        data = text + b"".join(one.tobytes() for one in self.rows.values())
        return hashlib.sha256(data).digest() + data

    @classmethod
    def of_bytes(cls, data: bytes) -> Marker:
        """Read a marker; raises ValueError, KeyError or TypeError where the file is damaged."""
        if hashlib.sha256(data[DIGEST:]).digest() != data[:DIGEST]:
            raise ValueError("it does not have its own digest")
        place = data.index(b"\n", DIGEST) + 1
        table = json.loads(data[DIGEST:place])
        table["files"] = {key: FileSum(*one) for key, one in table["files"].items()}
        table["failures"] = [FailedAttempt(*one) for one in table["failures"]]
        for name, (kind, shape) in table["rows"].items():
            values = np.frombuffer(data, kind, math.prod(shape), place).reshape(shape)
            table["rows"][name] = values
            place += values.nbytes
        return cls(**table)


def read_marker(job: Job, number: int) -> Marker | None:
    """The marker of a shard; None when there is none, or a damaged one: the shard is flown again.

    Raises:
      StoreError: it is that of another shard or recipe.
    """
    key = job.marker(number)
    try:
        found = Marker.of_bytes(job.files.read_small(key, FREE_BYTES))
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    if (found.number, found.recipe) != (number, job.digest):
        raise StoreError(
            f"{job.files.name}/{key} is of shard {found.number} of recipe {found.recipe[:12]}, "
            f"expected is {number} of recipe {job.digest[:12]}: remove that folder, or use another "
            "--out"
        )
    return found


def finished(job: Job, number: int, sizes: Mapping[str, int]) -> Marker | None:
    """The marker of a shard whose files are all in the tree, by the `sizes` there; else None."""
    found = read_marker(job, number)
    there = found and all(sizes.get(key) == one.bytes for key, one in found.files.items())
    return found if there else None
