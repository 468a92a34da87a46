"""Job: what a task needs to know of the store that it works for."""

from __future__ import annotations

import dataclasses
import functools
import threading

from factory.generation.layout import Layout
from factory.generation.site import Site
from factory.recipe.recipe import Recipe, versions
from twin.errors import StoreError

_READY: dict[str, Recipe] = {}
"""Recipes of this process by their hashes: each is planned and compiled once."""
_MOST_READY = 4


ALONE = threading.RLock()
"""Held by what flies or assembles: MuJoCo's warnings, numba's tables and staging folders are those
of the whole process, whose executor may have threads"""


@dataclasses.dataclass(frozen=True)
class Job:
    """A recipe and the place of its store; picklable."""

    recipe: Recipe
    site: Site

    @functools.cached_property
    def layout(self) -> Layout:
        """Blocks and shards."""
        return Layout(len(self.ready().plan))

    def ready(self) -> Recipe:
        """The recipe, with everything that it derives made once in a process.

        Raises:
          StoreError: on this machine it is another one, since libraries differ.
        """
        found = _READY.get(self.site.recipe)
        if found is None:
            if self.recipe.digest != self.site.recipe:
                here = ", ".join(f"{name} {number}" for name, number in versions().items())
                raise StoreError(
                    f"recipe {self.site.recipe[:12]} is not of this machine, which has {here}: "
                    "install the same versions wherever one store is made"
                )
            while len(_READY) >= _MOST_READY:
                del _READY[next(iter(_READY))]
            found = _READY[self.site.recipe] = self.recipe
        return found
