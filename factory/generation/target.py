"""Target: the name that a store is to have: whether it is free, and how the store gets it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from factory.generation.completion import FAILED_MISSION
from factory.generation.job import Job, missions_kept
from factory.sampling.recipe import Recipe, differences, read_recipe
from twin.errors import StoreError
from twin.records.attributes import CHANGES, FAILED_MISSIONS, SETTINGS, VEHICLE_MJCF, is_logged
from twin.records.presence import (
    RECIPE,
    begun,
    begun_within,
    check_ending,
    check_version,
    generating,
    is_complete,
    is_there,
    is_unfinished,
    read_attributes,
)
from twin.records.storage.sharded import METADATA
from twin.records.storage.store_path import StorePath, files_at
from twin.records.storage.whole import take_place

OLDER = ("blocks", "shards")
"""Folders in which an older glider-twin kept what it had made"""
MAX_DIFFERENCES = 5
"""Differences named when a resume is refused."""


def check_target(
    recipe: Recipe, store: StorePath, *, resume: bool, overwrite: bool, alone: bool = False
) -> bool:
    """Whether the store is there already, complete and of this recipe.

    Args:
      alone: nobody else works for this store: what runs of other recipes have begun is removed
        when `overwrite` says so.

    Raises:
      StoreError: something is in the way, or another recipe is to be resumed.
    """
    check_ending(store)
    local = isinstance(store, Path)
    if isinstance(store, Path):
        if store.is_symlink() and not store.exists():
            raise StoreError(f"{store} is a link to a missing target; choose another --out")
        present = store.exists() and not (store.is_dir() and not any(store.iterdir()))
    else:
        present = is_there(store)
    complete, others, within = is_complete(store), begun(store), begun_within(store)
    older = within or any(name in OLDER for path in others for name in files_at(path).folders())
    way = "use --overwrite or another --out" if local else "use another --out"
    if not local and overwrite and (present or others):
        raise StoreError(
            f"{store} is there already, and an object storage cannot replace a store in one step: "
            f"choose another --out, or remove everything below {store} and {generating(store)}"
        )
    if present and not (complete or within or (others and not local)):
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
    if older and not overwrite:
        raise StoreError(
            f"store {store} was begun by an older glider-twin and is incomplete: "
            + ("--overwrite starts again" if local else "use another --out")
        )
    if overwrite and not resume:
        if alone:
            for other in others:
                files_at(other).remove_all()
        return False
    for other in others:
        # without locks it is unknown whether a run that has kept nothing yet is alive
        if local and not missions_kept(other):
            if alone:  # nothing is lost
                files_at(other).remove_all()
            continue
        if not resume:
            again = ", --overwrite starts again" if local else ""
            raise StoreError(f"store {store} is incomplete: --resume completes it{again}")
        _check_same(store, _document(other)[SETTINGS], recipe, way)
    return False


def give_name(job: Job) -> None:
    """Make a store of the complete tree; what was under its name goes.

    Raises:
      OSError: the disk refuses; the tree stays, and --resume goes on from it.
    """
    job.tree.settle()
    if isinstance(job.store, Path) and isinstance(job.folder, Path):
        take_place(job.folder / "tree", job.store, job.folder / "replaced")
    job.clear()


class Unfinished(NamedTuple):
    """A store that a run has begun and not completed."""

    store: StorePath
    settings: dict[str, Any]
    missions_kept: int


def unfinished(path: StorePath) -> Unfinished | None:
    """Describe an unfinished store; None when the store is complete or there is none."""
    if not is_unfinished(path):
        return None
    for folder in begun(path):
        return Unfinished(path, _document(folder)[SETTINGS], missions_kept(folder))
    raise StoreError(
        f"store {path} was begun by an older glider-twin and is incomplete: `factory generate "
        "--overwrite` starts again"
    )


def recipe_begun(path: StorePath) -> Recipe:
    """The recipe of a run that was begun, from its folder; raises StoreError."""
    return read_recipe(_document(path))


def recipe_of(store: StorePath) -> Recipe:
    """The recipe of a complete store; raises StoreError."""
    attributes = read_attributes(store)
    changes, vehicle = json.loads(attributes.get(CHANGES, "{}")), attributes.get(VEHICLE_MJCF)
    return read_recipe({SETTINGS: _settings(store), CHANGES: changes, VEHICLE_MJCF: vehicle})


def failures_in(store: StorePath) -> int:
    """Attempts that failed and were replaced, in a complete store."""
    table = json.loads(files_at(store).read_small(METADATA))["consolidated_metadata"]["metadata"]
    if FAILED_MISSION in table:
        return int(table[FAILED_MISSION]["shape"][0])
    return len(json.loads(read_attributes(store).get(FAILED_MISSIONS, "[]")))


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
