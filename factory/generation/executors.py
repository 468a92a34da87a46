"""Executors: a pool of processes on this machine, or a dask cluster, to fly missions in parallel.

Processes are forked if the system can fork, because a fresh interpreter needs seconds to import and
compile the code again. A worker ignores Ctrl-C, which its parent handles. Unlike a worker of the
standard pool, it ends when its parent dies.
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
"""Number of times that dask flies a shard again after an error, perhaps with another worker. If a
worker is lost, dask's setting distributed.scheduler.allowed-failures decides instead.
"""
TIMEOUT_S = 30.0
"""[s] Longest time to reach the scheduler"""
WORKERS_S = 10.0
"""[s] Longest wait for a first worker; then a warning follows."""
VERSION = "factory.generation.completion:__version__"
"""Object that a worker must be able to import in this version, to fly shards"""


@contextlib.contextmanager
def local_pool(workers: int, *, fork: bool = True) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of processes on this machine; an interrupt while the pool ends kills them.

    Args:
      fork: whether processes may be forked; libraries with threads, such as clients of object
        storages, do not work in forked processes.
    """
    fork = fork and "fork" in multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("fork" if fork else "spawn")
    executor = ProcessPoolExecutor(workers, mp_context=context, initializer=_prepare_worker)
    with warnings.catch_warnings():
        # Python 3.12 warns of forks in a process with threads; here these are idle pools of
        # numeric libraries, which allow forks
        warnings.simplefilter("ignore", DeprecationWarning)
        executor.submit(int).result()  # forks all workers before zarr starts threads
    children = multiprocessing.active_children()
    try:
        yield executor
    finally:
        try:  # after an error each worker finishes its shard, and queued shards are dropped
            executor.shutdown(cancel_futures=True)
        except KeyboardInterrupt:
            for child in children:
                child.kill()
            raise


def _prepare_worker() -> None:
    """Prepare a new worker: close inherited locks, set signal handlers, watch the parent."""
    close_locks()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN if number == signal.SIGINT else signal.SIG_DFL)
    threading.Thread(target=_watch_parent, daemon=True, name="parent watch").start()


def _watch_parent() -> None:
    """End this process when its parent ends, because its results would be lost."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


@contextlib.contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Yield an executor with the workers of the dask scheduler at `address`.

    Example of an address: tcp://127.0.0.1:8786. Clusters of dask-jobqueue and dask-kubernetes have
    an address too. Workers may join and leave.

    Raises:
      InputError: dask.distributed is not installed, no scheduler answers, or a worker lacks this
        version of glider-twin.
      TwinError: the cluster was lost during the work."""
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
    log = logging.getLogger("distributed.client")  # logs a traceback when the scheduler is lost
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

    A task that a worker cannot import would end that worker, and then the next worker.
    """
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        warnings.warn(f"--scheduler {address} has no workers yet: waiting for some", stacklevel=2)
    found = client.run(pkgutil.resolve_name, VERSION, on_error="return")
    try:
        found["the scheduler"] = client.run_on_scheduler(pkgutil.resolve_name, VERSION)
    except Exception as error:  # an import may raise any error
        found["the scheduler"] = error
    for place, version in found.items():
        if version != __version__ and not isinstance(version, OSError):  # OSError: it has left
            has = "cannot import it" if isinstance(version, Exception) else "has"
            raise InputError(
                f"--scheduler {address} needs glider-twin {__version__} on the scheduler and all "
                f"workers: {place} {has} ({' '.join(str(version).split())})"
            )
