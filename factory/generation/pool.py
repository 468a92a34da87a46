"""Pool: the standard pool of processes, as `generate` uses it when it is given no executor.

Processes are forked once everything is imported and compiled, where the system can fork: a fresh
interpreter would need seconds for that. A worker ignores Ctrl-C, which its parent answers, and ends
when the parent dies, which the standard pool does not see to.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

from factory.generation.site import let_go

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
