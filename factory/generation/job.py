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
Target: the name that a store is to have: whether it is free, and how the store gets it.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from factory.sampling.recipe import Recipe, differences, read_recipe
from twin.errors import StoreError
from twin.records.attributes import CHANGES, SETTINGS, VEHICLE_MJCF, is_logged
from twin.records.presence import (
    RECIPE,
    begun,
    check_ending,
    check_version,
    generating,
    is_complete,
    is_there,
    read_attributes,
)
from twin.records.storage.disk import lock, sweep, sync_tree
from twin.records.storage.store_path import Files, StorePath, Url, files_at
from twin.records.storage.whole import take_place

DIGITS = 16
"""Of a recipe's hash, in names of folders"""
MARKER = re.compile(r"done/(\d{7,12})-(\d{7,12})")
"""Key of a shard's marker: its first and last mission"""
_READY: dict[str, Recipe] = {}
"""The recipe that this process had last, by its hash: it is planned and compiled once. Forked
workers have that of their parent."""
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
MAX_DIFFERENCES = 5
"""Differences named when a resume is refused."""


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

    def __init__(self, recipe: Recipe, store: StorePath):
        self.store, self.recipe, self.digest = store, recipe, recipe.digest
        self._text = json.dumps(recipe.document())
        _READY.clear()
        _READY[self.digest] = recipe

    def __getstate__(self) -> dict[str, Any]:
        return {"store": self.store, "digest": self.digest, "_text": self._text}

    @functools.cached_property
    def recipe(self) -> Recipe:
        """Recipe of the store.

        Raises:
          StoreError: libraries have other versions here, so that it would make other bytes.
        """
        found = _READY.get(self.digest)
        if found is None:
            found = read_recipe(json.loads(self._text))
            _READY.clear()
            _READY[self.digest] = found
        return found

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
        return files_at(self.folder / "tree" if self.local else self.store)

    def marker(self, shard: int) -> str:
        """Key of the marker of a shard, in `files`."""
        missions = self.layout.missions_of(shard)
        return f"done/{missions[0]:07d}-{missions[-1]:07d}"

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

    def give_name(self) -> None:
        """Make a store of the complete tree; what was under its name goes.

        Raises:
          OSError: the disk refuses; the tree stays, and --resume goes on from it.
        """
        if isinstance(self.store, Path) and isinstance(self.folder, Path):
            sync_tree(self.folder / "tree")
            take_place(self.folder / "tree", self.store, self.folder / "replaced")
        self.clear()


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
    descriptor = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    _HELD.add(descriptor)
    try:
        if not lock(descriptor, shared=shared):
            raise StoreError(
                f"another run is generating into {store}; wait for it or use another --out"
            )
        yield
    finally:
        _HELD.discard(descriptor)
        os.close(descriptor)


def close_locks() -> None:
    """Close the locks that a forked process has of its parent: only the parent may hold them."""
    while _HELD:
        os.close(_HELD.pop())


def check_target(
    recipe: Recipe, store: StorePath, *, resume: bool, overwrite: bool, alone: bool = False
) -> bool:
    """Check the place of a store; True where it is complete and of this recipe already.

    Args:
      alone: nobody else works for this store: what runs of other recipes have begun is removed
        when `overwrite` says so.

    Raises:
      StoreError: something is in the way, or another recipe is to be resumed.
    """
    check_ending(store)
    local, present = isinstance(store, Path), is_there(store)
    if isinstance(store, Path):
        if store.is_symlink() and not present:
            raise StoreError(f"{store} is a link to a missing target; choose another --out")
        present = present and not (store.is_dir() and not any(store.iterdir()))
    complete, others = is_complete(store), begun(store)
    way = "use --overwrite or another --out" if local else "use another --out"
    if not local and overwrite and (present or others):
        raise StoreError(
            f"{store} is there already, and an object storage cannot replace a store in one step: "
            f"choose another --out, or remove everything below {store} and {generating(store)}"
        )
    if present and not (complete or (others and not local)):
        raise StoreError(f"{store} exists and is not a store; choose another --out")
    if complete and not overwrite:
        if not resume:
            raise StoreError(f"store {store} already exists; {way}")
        settings = _settings(store)
        if differences(settings, recipe.describe()) and Job(recipe, store).folder in others:
            raise StoreError(
                f"store {store} is of other settings, and one of these was begun in its place: "
                "--overwrite --resume completes that"
            )
        _check_same(store, settings, recipe, way)
        return True
    for other in others:
        # without locks it is unknown whether a run that has kept nothing yet is alive
        if (overwrite and not resume) or (local and not missions_kept(other)):
            if alone:
                files_at(other).remove_all()
            continue
        if not resume:
            again = ", --overwrite starts again" if local else ""
            raise StoreError(f"store {store} is incomplete: --resume completes it{again}")
        _check_same(store, _document(other)[SETTINGS], recipe, way)
    return False


class Unfinished(NamedTuple):
    """A store that a run has begun and not completed."""

    settings: dict[str, Any]
    missions_kept: int


def unfinished(path: StorePath) -> Unfinished | None:
    """Describe an unfinished store; None when the store is complete or there is none."""
    for folder in [] if is_complete(path) else begun(path):
        return Unfinished(_document(folder)[SETTINGS], missions_kept(folder))
    return None


def recipe_begun(path: StorePath) -> Recipe:
    """The recipe of a run that was begun, from its folder; raises StoreError."""
    return read_recipe(_document(path))


def recipe_of(store: StorePath) -> Recipe:
    """The recipe of a complete store; raises StoreError."""
    attributes = read_attributes(store)
    changes, vehicle = json.loads(attributes.get(CHANGES, "{}")), attributes.get(VEHICLE_MJCF)
    return read_recipe({SETTINGS: _settings(store), CHANGES: changes, VEHICLE_MJCF: vehicle})


def _check_same(store: StorePath, old: Mapping[str, Any], recipe: Recipe, way: str) -> None:
    changed = differences(old, recipe.describe())
    if changed:
        more = len(changed) - MAX_DIFFERENCES
        listing = "; ".join(changed[:MAX_DIFFERENCES]) + (f"; {more} more" if more > 0 else "")
        raise StoreError(
            f"store {store} was started with other settings ({listing}): resume with the old "
            f"ones, or {way}"
        )


def _document(path: StorePath) -> dict[str, Any]:
    """The recipe that a run was begun with."""
    try:
        document: dict[str, Any] = json.loads(files_at(path).read_small(RECIPE))
        _ = document[SETTINGS]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise StoreError(
            f"{path / RECIPE} is damaged ({type(error).__name__}); start again with --overwrite"
        ) from error
    return document


def _settings(store: StorePath) -> dict[str, Any]:
    attributes = read_attributes(store)
    check_version(attributes, store)
    if is_logged(attributes):
        raise StoreError(
            f"store {store} holds logs of real vehicles and cannot be resumed: choose another --out"
        )
    try:
        settings: dict[str, Any] = json.loads(attributes[SETTINGS])
    except (ValueError, KeyError) as error:
        raise StoreError(
            f"store {store} lacks the settings that made it; it is damaged or not the factory's "
            f"({type(error).__name__})"
        ) from error
    return settings
