"""Executors: what flies missions: a pool of this machine's processes, or a dask cluster.

Processes are forked, where the system can fork: a fresh interpreter would need seconds for what is
imported and compiled already. A worker ignores Ctrl-C, which its parent answers, and ends
when the parent dies, which the standard pool does not see to.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import multiprocessing.connection
import os
import pkgutil
import signal
import threading
import warnings
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, ProcessPoolExecutor
from typing import Any

from factory.generation.job import close_locks
from twin.errors import InputError, TwinError
from twin.extras import require
from twin.version import __version__

RETRIES = 2
"""Times that a shard which raised an error is flown again, perhaps by another worker. One whose
worker is lost is flown again by dask itself, see its setting distributed.scheduler.allowed-failures
"""
TIMEOUT_S = 30.0
"""[s] to reach the scheduler"""
WORKERS_S = 10.0
"""[s] after which a scheduler without workers is told of"""
VERSION = "factory.generation.completion:__version__"
"""What is there where shards can be flown"""


@contextlib.contextmanager
def local_pool(workers: int, *, fork: bool = True) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes on this machine; a second interrupt while it ends kills them.

    Args:
      fork: whether processes may be forked; what has threads, as clients of object storages have,
        does not work in them.
    """
    fork = fork and "fork" in multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("fork" if fork else "spawn")
    executor = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin)
    with warnings.catch_warnings():
        # Python 3.12 warns of forks beside threads; the ones there may be are idle pools of
        # numeric libraries, which take forks into account
        warnings.simplefilter("ignore", DeprecationWarning)
        executor.submit(int).result()  # forks all, before this process has threads of zarr
    children = multiprocessing.active_children()
    try:
        yield executor
    finally:
        try:  # after an error each worker finishes its shard, and the others are dropped
            executor.shutdown(cancel_futures=True)
        except KeyboardInterrupt:
            for child in children:
                child.kill()
            raise


def _begin() -> None:
    """A worker's first act."""
    close_locks()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN if number == signal.SIGINT else signal.SIG_DFL)
    threading.Thread(target=_watch_parent, daemon=True, name="parent watch").start()


def _watch_parent() -> None:
    """End this process when its parent has gone: nobody would ever take what it makes."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


@contextlib.contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """The workers of the scheduler at `address`, such as tcp://127.0.0.1:8786.

    Clusters of dask-jobqueue and dask-kubernetes have such an address too. Workers may come and go.

    Raises:
      InputError: dask.distributed is not installed, nobody answers there, or glider-twin is not
        there in this version.
      TwinError: the cluster was lost while it worked.
    """
    require("distributed", extra="cluster", purpose="--scheduler")
    import distributed
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    try:
        client = distributed.Client(address, timeout=TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"--scheduler {address}: no dask scheduler answers there "
            f"({' '.join(str(error).split())}); `dask scheduler` prints its address"
        ) from error
    log = logging.getLogger("distributed.client")  # it logs a traceback when a scheduler is gone
    with contextlib.ExitStack() as after, client:
        after.callback(log.setLevel, log.level)
        log.setLevel(logging.CRITICAL)
        try:
            _check_workers(client, address)
            yield client.get_executor(retries=RETRIES, pure=False)
        except (KilledWorker, CommClosedError, CancelledError) as error:
            reason = " ".join(str(error).split()) or "its scheduler is gone"
            raise TwinError(
                f"--scheduler {address}: the cluster was lost ({reason}). Finished shards are "
                "kept: --resume goes on from them"
            ) from error


def _check_workers(client: Any, address: str) -> None:
    """Raise InputError unless the scheduler and all workers can fly shards; warn of no workers.

    A task that a worker cannot even read would end that worker, and then the next one.
    """
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        warnings.warn(f"--scheduler {address} has no workers yet: waiting for some", stacklevel=2)
    found = client.run(pkgutil.resolve_name, VERSION, on_error="return")
    try:
        found["the scheduler"] = client.run_on_scheduler(pkgutil.resolve_name, VERSION)
    except Exception as error:  # whatever an import raises
        found["the scheduler"] = error
    for place, version in found.items():
        if version != __version__ and not isinstance(version, OSError):  # else it has gone away
            has = "cannot import it" if isinstance(version, Exception) else "has"
            raise InputError(
                f"--scheduler {address} needs glider-twin {__version__} on the scheduler and all "
                f"workers: {place} {has} ({' '.join(str(version).split())})"
            )
