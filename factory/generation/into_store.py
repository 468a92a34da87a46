"""Into store: missions into any zarr store that a program has opened, such as one of icechunk."""

from __future__ import annotations

import dataclasses
import tempfile
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING

from factory.generation.generate import Summary, Watcher, generate
from factory.recipe.recipe import Recipe
from twin.records.files import LocalFiles
from twin.records.zarr_copy import check_empty, copy_into

if TYPE_CHECKING:
    from twin.records.zarr_copy import AnyStore


def generate_into(
    recipe: Recipe,
    store: AnyStore,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    watch: Watcher | None = None,
) -> Summary:
    """Make the missions in a temporary folder of this machine, then copy every key.

    Nothing is committed: a store with sessions, as icechunk has, keeps them by one commit of its
    own when this returns.

    Args:
      store: empty, and open for writing.
      workers, executor, watch: as of `generate`.

    Returns:
      What was done, of `store`.

    Raises:
      StoreError: the store is read-only or holds something, and as `generate`.
    """
    check_empty(store)
    with tempfile.TemporaryDirectory(prefix="glider-twin-") as folder:
        made = Path(folder) / "missions.zarr"
        summary = generate(recipe, made, workers=workers, executor=executor, watch=watch)
        copy_into(LocalFiles(made), store)
    return dataclasses.replace(summary, store=store)
