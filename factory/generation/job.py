"""Job: what a task needs to know of the store that it works for."""

from __future__ import annotations

import functools
import json
import threading
from typing import Any

from factory.generation.layout import Layout
from factory.generation.site import Site
from factory.recipe.recipe import Recipe, read_recipe

ALONE = threading.RLock()
"""Held by what flies or assembles: MuJoCo's warnings, numba's tables and staging folders are those
of the whole process, whose executor may have threads"""
_READY: dict[str, Recipe] = {}
"""Recipes of this process by their hashes: each is planned and compiled once. Forked workers have
those of their parent."""
_MOST_READY = 4


class Job:
    """A recipe and the place of its store.

    It travels to other processes as text, so that whatever a recipe holds, a sensor of a plugin
    too, is made there by the same registered kinds.
    """

    def __init__(self, recipe: Recipe, site: Site):
        self.site, self.recipe = site, recipe
        while len(_READY) >= _MOST_READY:
            del _READY[next(iter(_READY))]
        _READY[site.recipe] = recipe

    def __reduce__(self) -> tuple[Any, ...]:
        return _arrived, (self._text, self.site)

    @functools.cached_property
    def _text(self) -> str:
        return json.dumps(self.recipe.document())

    @functools.cached_property
    def layout(self) -> Layout:
        """Blocks and shards."""
        return Layout(len(self.recipe.plan))


def _arrived(text: str, site: Site) -> Job:
    """The job in another process.

    Raises:
      StoreError: libraries have other versions here, so that it would make other bytes.
    """
    return Job(_READY.get(site.recipe) or read_recipe(json.loads(text)), site)
