"""Pool: the standard pool of processes, as `generate` uses it when it is given no executor.

Processes are forked once everything is imported and compiled, where the system can fork: a fresh
interpreter would need seconds for that. A worker ignores Ctrl-C, which its parent answers, and ends
when the parent dies, which the standard pool does not see to.

Job: what a task needs to know of the store that it works for.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import json
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any

from factory.generation.manifest import Layout
from factory.generation.site import Site, let_go
from factory.sampling.recipe import Recipe, read_recipe

_FORK = "fork"


@contextlib.contextmanager
def local_pool(workers: int, *, fork: bool = True) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes on this machine; a second interrupt while it ends kills them.

    Args:
      fork: whether processes may be forked; what has threads, as clients of object storages have,
        does not work in them.
    """
    can_fork = fork and _FORK in multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context(_FORK if can_fork else "spawn")
    executor = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin)
    with warnings.catch_warnings():
        # Python 3.12 warns of forks beside threads; the ones there may be are idle pools of
        # numeric libraries, which take forks into account
        warnings.simplefilter("ignore", DeprecationWarning)
        executor.submit(int).result()  # forks all, before this process has threads of zarr
    children = multiprocessing.active_children()
    try:
        yield executor
    except BaseException:
        _end(executor, children)
        raise
    executor.shutdown()


def _end(
    executor: ProcessPoolExecutor, children: list[multiprocessing.process.BaseProcess]
) -> None:
    """Let each worker finish its block and drop the others; kill them on a second interrupt."""
    try:
        executor.shutdown(wait=True, cancel_futures=True)
    except KeyboardInterrupt:
        for child in children:
            child.kill()
        raise


def _begin() -> None:
    """A worker's first act."""
    let_go()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN if number == signal.SIGINT else signal.SIG_DFL)
    threading.Thread(target=_watch_parent, daemon=True, name="parent watch").start()


def _watch_parent() -> None:
    """End this process when its parent has gone: nobody would ever take what it makes."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


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
