"""Site: where a run keeps what it makes, until the store is complete.

Beside the store `NAME` lies the folder `NAME.generating`. It holds, for the recipe's hash, the
recipe itself, a file and a manifest of every finished block, a manifest of every shard, and `tree`,
which becomes the store in one step. So a store is under its name when it is complete and not
before, and what a run of another recipe leaves can never get into it.

An object storage has no such step. There the tree grows under the store's own name, and the store
is one when its `zarr.json` appears, which is written last. Locks it has none either, and needs none
for runs of one recipe, which write the same bytes. Those of two recipes must not meet there: the
first one that was begun keeps the name.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import json
import os
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

from factory.sampling.recipe import Recipe
from twin.errors import StoreError
from twin.records.presence import RECIPE, begun, generating
from twin.records.storage.disk import sweep
from twin.records.storage.object_storage import files_at
from twin.records.storage.store_path import StorePath, Url
from twin.records.storage.stored_files import Files

DIGITS = 16
"""Of a recipe's hash, in names of folders"""

_HELD: set[int] = set()
"""Open files that hold locks"""


class Site:
    """The working folder of one store and one recipe; picklable."""

    def __init__(self, store: StorePath, recipe: str):
        """`recipe` is the hash of a recipe."""
        self.store, self.recipe = store, recipe

    def __reduce__(self) -> tuple[type[Site], tuple[StorePath, str]]:
        """A pool's thread pickles it while this process opens `files`: those stay here."""
        return Site, (self.store, self.recipe)

    @property
    def local(self) -> bool:
        """Whether it is a folder of this machine."""
        return isinstance(self.store, Path)

    @property
    def folder(self) -> StorePath:
        """All that runs of this recipe keep."""
        return generating(self.store) / self.recipe[:DIGITS]

    @functools.cached_property
    def files(self) -> Files:
        """Blocks and manifests."""
        return files_at(self.folder)

    @functools.cached_property
    def tree(self) -> Files:
        """What will be the store."""
        return self.files.below("tree") if self.local else files_at(self.store)

    @property
    def staging(self) -> Path:
        """A folder of this process, where shards are made before they are whole."""
        if isinstance(self.folder, Path):
            return self.folder / f"staging-{socket.gethostname()}-{os.getpid()}"
        return Path(tempfile.gettempdir()) / f"glider-twin-{_token(os.getpid())}"

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
        """Make the folder, with the recipe in it; does nothing where it is.

        Raises:
          StoreError: another recipe was begun at the same moment, where there are no locks.
        """
        if self.files.exists(RECIPE):
            return
        self.files.write_safe(RECIPE, json.dumps(recipe.document(), indent=1).encode())
        others = [] if self.local else [p for p in begun(self.store) if p != self.folder]
        if others:
            self.files.remove(RECIPE)
            raise StoreError(
                f"{others[0]} belongs to a run of another recipe: use another --out, or remove "
                f"everything below {generating(self.store)} and {self.store}"
            )

    def clear(self) -> None:
        """Remove what this recipe's runs keep, and the folder when nothing else is in it."""
        self.files.remove_all()
        outer = generating(self.store)
        if not isinstance(outer, Path):
            return
        with contextlib.suppress(OSError):
            (outer / "lock").unlink(missing_ok=True)
            outer.rmdir()

    def sweep(self) -> None:
        """Remove what processes that are gone left half-written."""
        if isinstance(self.folder, Path):
            sweep(self.folder)


@functools.cache
def _token(process: int) -> str:
    """Of a process, in names of folders that nobody can foresee."""
    return f"{process}-{os.urandom(8).hex()}"


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


def let_go() -> None:
    """Close the locks that a forked process has of its parent: only the parent may hold them."""
    while _HELD:
        os.close(_HELD.pop())
