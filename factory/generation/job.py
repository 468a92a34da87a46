"""Job: what a task needs to know of the store that it works for."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import json
import threading
from collections.abc import Iterator
from typing import Any

from factory.generation.layout import Layout
from factory.generation.site import Site
from factory.recipe.recipe import Recipe, read_recipe

_ALONE = threading.RLock()
_READY: dict[str, Recipe] = {}
"""Recipes of this process by their hashes: each is planned and compiled once. Forked workers have
those of their parent."""
_MOST_READY = 4
_TRIM = getattr(ctypes.CDLL(None), "malloc_trim", None)
"""glibc's; None with another C library"""


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """One task at a time in this process, whose executor may have threads: MuJoCo's warnings,
    numba's tables and staging folders are those of the whole process.

    Afterwards what the task freed goes back to the system. glibc would keep it in pieces, and a
    process that flies for days would hold more and more.
    """
    with _ALONE:
        try:
            yield
        finally:
            if _TRIM is not None:
                _TRIM(0)


class Job:
    """A recipe and the place of its store.

    It travels to other processes as text, so that whatever a recipe holds, a sensor of a plugin
    too, is made there by the same registered kinds. The text is read by the task that needs it: a
    worker that cannot read it can say so then, and would end if it could not even take the task.
    """

    def __init__(self, recipe: Recipe | str, site: Site):
        """`recipe` may be its text, as `document` gives it."""
        self.site = site
        if isinstance(recipe, str):
            self._text = recipe
        else:
            self.recipe = recipe
            _keep(recipe, site)

    def __reduce__(self) -> tuple[Any, ...]:
        return Job, (self._text, self.site)

    @functools.cached_property
    def _text(self) -> str:
        return json.dumps(self.recipe.document())

    @functools.cached_property
    def recipe(self) -> Recipe:
        """What is to be made.

        Raises:
          StoreError: libraries have other versions here, so that it would make other bytes.
        """
        if self.site.recipe not in _READY:
            _keep(read_recipe(json.loads(self._text)), self.site)
        return _READY[self.site.recipe]

    @functools.cached_property
    def layout(self) -> Layout:
        """Blocks and shards."""
        return Layout(len(self.recipe.plan))


def _keep(recipe: Recipe, site: Site) -> None:
    """Have a recipe ready for the next job of this process."""
    while len(_READY) >= _MOST_READY:
        del _READY[next(iter(_READY))]
    _READY[site.recipe] = recipe
