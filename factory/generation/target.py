"""Target: the name that a store is to have: whether it is free, and how the store gets it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from factory.generation.completion import FAILED_MISSION
from factory.generation.job import Job
from factory.generation.manifest import missions_kept
from factory.generation.site import Site, begun
from factory.recipe.recipe import Recipe, differences, read_recipe, recipe_document
from twin.errors import StoreError
from twin.records.attributes import CHANGES, FAILED_MISSIONS, SETTINGS, VEHICLE_MJCF, is_logged
from twin.records.checksums import FileSum, write_checksums
from twin.records.disk import sync_file
from twin.records.files import LocalFiles
from twin.records.sharded import METADATA
from twin.records.store import UNFINISHED, is_complete, read_attributes
from twin.records.whole import take_place

MAX_DIFFERENCES = 5
"""Differences named when a resume is refused."""


def check_target(
    recipe: Recipe, store: Path, *, resume: bool, overwrite: bool, alone: bool = False
) -> bool:
    """Whether the store is there already, complete and of this recipe.

    Args:
      alone: nobody else works for this store: what runs of other recipes have begun is removed
        when `overwrite` says so.

    Raises:
      StoreError: something is in the way, or another recipe is to be resumed.
    """
    if store.is_symlink() and not store.exists():
        raise StoreError(f"{store} is a link to nothing; choose another --out")
    present, complete = _present(store), is_complete(store)
    if present and not (complete or (store / UNFINISHED).is_dir()):
        raise StoreError(f"{store} exists and is not a store; choose another --out")
    if complete and not overwrite:
        if not resume:
            raise StoreError(f"store {store} already exists; use --overwrite or another --out")
        if differences(_settings(store), recipe.describe()) and _begun_with(store, recipe):
            raise StoreError(
                f"store {store} is of other settings, and one of these was begun in its place: "
                "--overwrite --resume completes that"
            )
        _check_same(store, _settings(store), recipe)
        return True
    if present and not complete and not overwrite:
        raise StoreError(
            f"store {store} was begun by an older glider-twin and is incomplete: --overwrite "
            "starts again"
        )
    if overwrite and not resume:
        if alone:
            for other in begun(store):
                LocalFiles(other.parent).remove_all()
        return False
    for other in begun(store):
        if not missions_kept(Site(store, other.parent.name)):
            if alone:  # nothing is lost
                LocalFiles(other.parent).remove_all()
            continue
        if not resume:
            raise StoreError(
                f"store {store} is incomplete: --resume completes it, --overwrite starts again"
            )
        _check_same(store, _document(other)[SETTINGS], recipe)
    return False


def give_name(job: Job, files: Mapping[str, FileSum]) -> None:
    """Make a store of the complete tree; what was under its name goes.

    Args:
      files: checksums of all files of the tree, by key.

    Raises:
      OSError: the disk refuses; the tree stays, and --resume goes on from it.
    """
    site = job.site
    tree = site.folder / "tree"
    site.tree.settle()
    sync_file(write_checksums(tree, files))
    take_place(tree, site.store, site.folder / "replaced")
    site.clear()


def unfinished_settings(store: Path) -> list[tuple[Site, dict[str, Any]]]:
    """What runs were begun for a store and not completed, with the settings of each."""
    found = []
    for path in begun(store):
        settings = _document(path)[SETTINGS]
        found.append((Site(store, path.parent.name), settings))
    return found


def _begun_with(store: Path, recipe: Recipe) -> bool:
    """Whether a run of this recipe was begun."""
    return any(Site(store, recipe.digest).folder == path.parent for path in begun(store))


def recipe_begun(path: Path) -> Recipe:
    """The recipe of a run that was begun, from its file; raises StoreError."""
    return read_recipe(_document(path))


def recipe_of(store: Path) -> Recipe:
    """The recipe of a complete store; raises StoreError."""
    attributes = read_attributes(store)
    known = {CHANGES: "{}", VEHICLE_MJCF: None, **attributes, SETTINGS: _settings(store)}
    return read_recipe(recipe_document(known))


def failures_in(store: Path) -> int:
    """Attempts that failed and were replaced, in a complete store."""
    table = json.loads((store / METADATA).read_bytes())["consolidated_metadata"]["metadata"]
    if FAILED_MISSION in table:
        return int(table[FAILED_MISSION]["shape"][0])
    return len(json.loads(read_attributes(store).get(FAILED_MISSIONS, "[]")))


def _present(store: Path) -> bool:
    """Whether something is under the name; an empty folder is nothing."""
    return store.exists() and not (store.is_dir() and not any(store.iterdir()))


def _check_same(store: Path, old: Mapping[str, Any], recipe: Recipe) -> None:
    changed = differences(old, recipe.describe())
    if changed:
        more = len(changed) - MAX_DIFFERENCES
        listing = "; ".join(changed[:MAX_DIFFERENCES]) + (f"; {more} more" if more > 0 else "")
        raise StoreError(
            f"store {store} was started with other settings ({listing}): resume with the old "
            "ones, or use --overwrite or another --out"
        )


def _document(path: Path) -> dict[str, Any]:
    """The recipe that a run was begun with."""
    try:
        document: dict[str, Any] = json.loads(path.read_bytes())
        _ = document[SETTINGS]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StoreError(
            f"{path} is damaged ({type(error).__name__}); start again with --overwrite"
        ) from error
    return document


def _settings(store: Path) -> dict[str, Any]:
    attributes = read_attributes(store)
    if is_logged(attributes):
        raise StoreError(
            f"store {store} holds logs of real vehicles, there is nothing to resume: choose "
            "another --out"
        )
    try:
        settings: dict[str, Any] = json.loads(attributes[SETTINGS])
    except (ValueError, KeyError) as error:
        raise StoreError(
            f"store {store} does not say what it was made with; it is damaged or not the factory's "
            f"({type(error).__name__})"
        ) from error
    return settings
