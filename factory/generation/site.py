"""Site: where a run keeps what it makes, until the store is complete.

Beside the store `NAME` lies the folder `NAME.generating`. It holds, for the recipe's hash, the
recipe itself, a file and a manifest of every finished block, a manifest of every shard, and `tree`,
which becomes the store in one step. So a store is under its name when it is complete and not
before, and what a run of another recipe leaves can never get into it.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import json
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from factory.recipe.recipe import Recipe
from twin.errors import StoreError
from twin.records.disk import sweep, write_whole
from twin.records.files import Files, LocalFiles
from twin.records.store import GENERATING, RECIPE

DIGITS = 16
"""Of a recipe's hash, in names of folders"""

_HELD: set[int] = set()
"""Open files that hold locks"""


class Site:
    """The working folder of one store and one recipe; picklable."""

    def __init__(self, store: Path, recipe: str):
        """`recipe` is the hash of a recipe."""
        self.store, self.recipe = store, recipe

    @property
    def folder(self) -> Path:
        """All that runs of this recipe keep."""
        return generating(self.store) / self.recipe[:DIGITS]

    @functools.cached_property
    def files(self) -> Files:
        """Blocks and manifests."""
        return LocalFiles(self.folder)

    @functools.cached_property
    def tree(self) -> Files:
        """What will be the store."""
        return self.files.below("tree")

    @property
    def staging(self) -> Path:
        """A folder of this process, where shards are made before they are whole."""
        return self.folder / f"staging-{socket.gethostname()}-{os.getpid()}"

    @staticmethod
    def block(number: int) -> str:
        """Key of a block's signals; its manifest has .json instead of .npz."""
        return f"blocks/{number:06d}.npz"

    @staticmethod
    def block_manifest(number: int) -> str:
        """Key of a block's manifest."""
        return f"blocks/{number:06d}.json"

    @staticmethod
    def shard_rows(number: int) -> str:
        """Key of the values that a shard has one of for each mission."""
        return f"shards/{number:05d}.npz"

    @staticmethod
    def shard_manifest(number: int) -> str:
        """Key of a shard's manifest."""
        return f"shards/{number:05d}.json"

    def begin(self, recipe: Recipe) -> None:
        """Make the folder, with the recipe in it; does nothing where it is."""
        target = self.folder / RECIPE
        if not target.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            write_whole(target, json.dumps(recipe.document(), indent=1).encode())

    def clear(self) -> None:
        """Remove what this recipe's runs keep, and the folder when nothing else is in it."""
        self.files.remove_all()
        outer = generating(self.store)
        with contextlib.suppress(OSError):
            (outer / "lock").unlink(missing_ok=True)
            outer.rmdir()

    def sweep(self) -> None:
        """Remove what processes that are gone left half-written."""
        sweep(self.folder)


def generating(store: Path) -> Path:
    """The folder beside a store that runs work in."""
    return store.with_name(store.name + GENERATING)


def begun(store: Path) -> list[Path]:
    """Recipes of runs that were begun and not completed."""
    return sorted(generating(store).glob(f"*/{RECIPE}"))


@contextlib.contextmanager
def locked(store: Path, *, shared: bool = False) -> Iterator[None]:
    """Hold the working folder of a store for this process, alone or with others that share it.

    Raises:
      StoreError: another run is working there.
    """
    folder = generating(store)
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


def let_go() -> None:
    """Close the locks that a forked process has of its parent: only the parent may hold them."""
    while _HELD:
        os.close(_HELD.pop())
