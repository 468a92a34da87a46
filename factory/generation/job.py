"""Job: a recipe and the path of its store, which every worker process receives.

Beside the store `NAME` lies the folder `NAME.generating`. Each recipe has a folder there, named by
the recipe's hash, with the recipe, a marker of every finished shard, and `tree`, which becomes the
store in one rename. So NAME exists only if the store is complete, and recipes never mix.

An object storage has no rename. There the tree grows under the store's own name, and the store is
complete when its `zarr.json` exists, which is written last. An object storage has no locks either.
Runs of one recipe need none, because they write the same bytes. A run of another recipe is refused:
the recipe that began first keeps the name.

`Layout` divides the missions into shards; batched missions make fewer and larger ones.
`check_target` checks the name of a store before a run.
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
from twin.records.storage.whole import REPLACE, take_place

DIGITS = 16
"""Number of digits of a recipe's hash in the name of its folder"""
MARKER = re.compile(r"done/(\d{7,12})-(\d{7,12})")
"""Key of a shard's marker, with the shard's first and last mission"""
_LAST_RECIPE: dict[str, Recipe] = {}
"""Last recipe of this process by its hash, kept so that it is planned and compiled only once.
Forked workers inherit it from their parent."""
_LOCKS: set[int] = set()
"""Descriptors of open files with locks"""
MOST_IN_SHARD = 64
"""Maximum number of missions in a small store's shard: 48 h of preset paper, 1 MB per signal"""
SHARDS_PER_STORE = 8
"""Number of shards that is aimed at, to occupy parallel workers; 17 missions make 6."""
SHARDS_ABREAST = 4
"""Number of shards that is aimed at with the batched engine. In a batch of 64, a mission takes a
twentieth of the time that it takes alone."""
MOST_SHARDS = 192
"""Maximum number of shards; then they grow, so a million missions stay below 20 000 files."""
ROWS = 65_536
"""Maximum number of missions in a chunk of an array over missions, rounded down to whole shards"""
MAX_DIFFERENCES = 5
"""Maximum number of differences between recipes that an error names"""


class Layout(NamedTuple):
    """Division of a store's missions into shards."""

    missions: int
    abreast: int = 1
    """Number of missions in a batch of the engine"""

    @property
    def shard_missions(self) -> int:
        """Number of missions in each shard; the last shard may have fewer."""
        least = SHARDS_PER_STORE if self.abreast == 1 else SHARDS_ABREAST
        usual = min(MOST_IN_SHARD, -(-self.missions // least))
        return usual * -(-self.missions // (usual * MOST_SHARDS))

    @property
    def row_missions(self) -> int:
        """Number of missions in each chunk of an array over missions: whole shards."""
        shard = self.shard_missions
        return min(self.missions, shard * max(1, ROWS // shard))

    @property
    def shards(self) -> range:
        """Numbers of all shards."""
        return range(-(-self.missions // self.shard_missions))

    def missions_of(self, shard: int) -> range:
        """Numbers of the missions of a shard."""
        size = self.shard_missions
        return range(shard * size, min((shard + 1) * size, self.missions))


class Job:
    """Recipe and path of its store.

    A job is pickled with its recipe as text, so that another process builds all parts, also those
    of plugins, from its own registries. Only a task that needs the recipe reads the text: a worker
    that cannot read the text then raises an error, while a failed unpickling would end the worker.
    """

    def __init__(self, recipe: Recipe, store: StorePath):
        self.store, self.recipe, self.digest = store, recipe, recipe.digest
        self._text = json.dumps(recipe.document())
        _LAST_RECIPE.clear()
        _LAST_RECIPE[self.digest] = recipe

    def __getstate__(self) -> dict[str, Any]:
        return {"store": self.store, "digest": self.digest, "_text": self._text}

    @functools.cached_property
    def recipe(self) -> Recipe:
        """Recipe of the store.

        Raises:
          StoreError: libraries here have other versions, which would make other bytes.
        """
        found = _LAST_RECIPE.get(self.digest)
        if found is None:
            found = read_recipe(json.loads(self._text))
            _LAST_RECIPE.clear()
            _LAST_RECIPE[self.digest] = found
        return found

    @functools.cached_property
    def layout(self) -> Layout:
        """Division of the missions into shards."""
        return Layout(len(self.recipe.plan), self.recipe.abreast)

    @property
    def local(self) -> bool:
        """True if the store is a folder of this machine."""
        return isinstance(self.store, Path)

    @property
    def folder(self) -> StorePath:
        """Folder with all files that runs of this recipe keep."""
        return generating(self.store) / self.digest[:DIGITS]

    @functools.cached_property
    def files(self) -> Files:
        """Files of the folder: the recipe and markers."""
        return files_at(self.folder)

    @functools.cached_property
    def tree(self) -> Files:
        """Files that become the store."""
        return files_at(self.folder / "tree" if self.local else self.store)

    def marker(self, shard: int) -> str:
        """Return the key of a shard's marker in `files`."""
        missions = self.layout.missions_of(shard)
        return f"done/{missions[0]:07d}-{missions[-1]:07d}"

    def begin(self) -> None:
        """Write the recipe into the folder, unless it is there.

        Raises:
          StoreError: in an object storage, a run of another recipe began at the same moment.
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
        """Remove temporary files of dead processes; the caller must hold the lock alone."""
        if isinstance(self.folder, Path):
            sweep(self.folder)

    def clear(self) -> None:
        """Remove the folder of this recipe, and `NAME.generating` if it is empty then.

        The caller must hold the lock alone.
        """
        self.files.remove_all()
        outer = generating(self.store)
        if isinstance(outer, Path):
            with contextlib.suppress(OSError):
                for left in outer.iterdir():  # left by runs that were killed before `begin`
                    if left.is_dir() and not (left / RECIPE).exists():
                        shutil.rmtree(left, ignore_errors=True)
                (outer / "lock").unlink(missing_ok=True)
                outer.rmdir()

    def give_name(self) -> None:
        """Rename the complete tree to the store's name, replacing an old store there.

        Raises:
          OSError: the disk refuses; the tree stays, and --resume continues from it.
        """
        if isinstance(self.store, Path) and isinstance(self.folder, Path):
            sync_tree(self.folder / "tree")
            take_place(self.folder / "tree", self.store, self.folder / "replaced")
        self.clear()


def missions_kept(folder: StorePath) -> int:
    """Count the missions in an unfinished run's finished shards, by the names of the markers."""
    found = map(MARKER.fullmatch, files_at(folder).all_keys())
    return sum(max(0, int(one[2]) - int(one[1]) + 1) for one in found if one)


@contextlib.contextmanager
def locked(store: StorePath, *, shared: bool = False) -> Iterator[None]:
    """Lock the working folder of a store for this process, alone or shared with other processes.

    In an object storage, which has no locks, this does nothing.

    Raises:
      StoreError: another run holds the lock.
    """
    folder = generating(store)
    if isinstance(folder, Url):
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    _LOCKS.add(descriptor)
    try:
        if not lock(descriptor, shared=shared):
            raise StoreError(
                f"another run is generating into {store}; wait for it or use another --out"
            )
        yield
    finally:
        _LOCKS.discard(descriptor)
        os.close(descriptor)


def close_locks() -> None:
    """Close the locks that a forked process inherits: only the parent may hold them."""
    while _LOCKS:
        os.close(_LOCKS.pop())


def check_target(
    recipe: Recipe, store: StorePath, *, resume: bool, overwrite: bool, alone: bool = False
) -> bool:
    """Check the path of a store; True if a complete store of this recipe is there already.

    Args:
      alone: True if this process alone holds the lock. Unfinished runs are then removed if they
        have no finished shard, or if `overwrite` replaces them.

    Raises:
      StoreError: the path holds something else, or an unfinished store of another recipe.
    """
    check_ending(store)
    local, present = isinstance(store, Path), is_there(store)
    if isinstance(store, Path):
        if store.is_symlink() and not present:
            raise StoreError(f"{store} is a link to a missing target; choose another --out")
        present = present and not (store.is_dir() and not any(store.iterdir()))
    complete, others = is_complete(store), begun(store)
    way = f"{REPLACE} or another --out" if local else "use another --out"
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
        settings = _read_settings(store)
        if differences(settings, recipe.describe()) and Job(recipe, store).folder in others:
            raise StoreError(
                f"store {store} is of other settings, and one of these was begun in its place: "
                "--overwrite --resume completes that"
            )
        _check_same(store, settings, recipe, way)
        return True
    for other in others:
        # in an object storage, a run without finished shards may still be alive
        if (overwrite and not resume) or (local and not missions_kept(other)):
            if alone:
                files_at(other).remove_all()
            continue
        if not resume:
            again = ", --overwrite starts again" if local else ""
            raise StoreError(f"store {store} is incomplete: --resume completes it{again}")
        _check_same(store, _read_document(other)[SETTINGS], recipe, way)
    return False


class Unfinished(NamedTuple):
    """Store that a run began and did not complete."""

    settings: dict[str, Any]
    missions_kept: int


def unfinished(path: StorePath) -> Unfinished | None:
    """Describe an unfinished store; None if the store is complete or there is none."""
    for folder in [] if is_complete(path) else begun(path):
        return Unfinished(_read_document(folder)[SETTINGS], missions_kept(folder))
    return None


def recipe_begun(path: StorePath) -> Recipe:
    """Read the recipe of an unfinished run from its folder; raises StoreError."""
    return read_recipe(_read_document(path))


def recipe_of(store: StorePath) -> Recipe:
    """Read the recipe of a complete store; raises StoreError."""
    attributes = read_attributes(store)
    changes, vehicle = json.loads(attributes.get(CHANGES, "{}")), attributes.get(VEHICLE_MJCF)
    return read_recipe({SETTINGS: _read_settings(store), CHANGES: changes, VEHICLE_MJCF: vehicle})


def _check_same(store: StorePath, old: Mapping[str, Any], recipe: Recipe, way: str) -> None:
    changed = differences(old, recipe.describe())
    if changed:
        more = len(changed) - MAX_DIFFERENCES
        listing = "; ".join(changed[:MAX_DIFFERENCES]) + (f"; {more} more" if more > 0 else "")
        raise StoreError(
            f"store {store} was started with other settings ({listing}): resume with the old "
            f"ones, or {way}"
        )


def _read_document(path: StorePath) -> dict[str, Any]:
    """Read the file with the recipe of an unfinished run."""
    try:
        document: dict[str, Any] = json.loads(files_at(path).read_small(RECIPE))
        _ = document[SETTINGS]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise StoreError(
            f"{path / RECIPE} is damaged ({type(error).__name__}); start again with --overwrite"
        ) from error
    return document


def _read_settings(store: StorePath) -> dict[str, Any]:
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
