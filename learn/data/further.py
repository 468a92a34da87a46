"""Further missions: flights by a store's recipe with a seed of their own, to judge by."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from twin.errors import TwinError
from twin.records.attributes import SETTINGS
from twin.records.presence import read_attributes
from twin.records.storage.store_path import StorePath

if TYPE_CHECKING:
    from factory.sampling.recipe import Recipe


def recipe_to_fly(store: str | StorePath, refused: Callable[[str], None]) -> Recipe | None:
    """Recipe of a simulated store; None for logs, for other versions' recipes and fixed missions.

    Args:
      refused: called with the reason why another version's recipe cannot be flown.
    """
    from factory.generation.generated_store import GeneratedStore
    from factory.sampling.presets import PRESETS

    if SETTINGS not in read_attributes(store):
        return None
    try:
        recipe = GeneratedStore(store).recipe
    except TwinError as error:
        refused(str(error))
        return None
    return None if PRESETS[recipe.preset].fixed_missions else recipe


def longer(recipe: Recipe, count: int, *, seed: int) -> Recipe:
    """Recipe of at least `count` missions with another seed, by the batched engine if it can."""
    more, hours = recipe, count * recipe.plan.hours / len(recipe.plan)
    engine = "lanes"
    while more is recipe or len(more.plan) < count:  # durations are sampled
        try:
            more = dataclasses.replace(recipe, seed=seed, hours=hours, engine=engine)
        except TwinError:  # a vehicle that the batched engine cannot fly
            if engine == recipe.engine:
                raise
            engine = recipe.engine
            continue
        hours *= 1.05
    return more


def fly_further(recipe: Recipe, folder: Path, word: str) -> StorePath:
    """Fly a recipe into `folder`, as a store named by `word` and the recipe; returns its path."""
    from factory.generation.generation import generate

    path = folder / f"{word}-{recipe.digest[:8]}.zarr"
    generate(recipe, path, resume=True, history="learn")
    return path
