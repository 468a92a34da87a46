"""A dask cluster of processes on this machine, started as people start it; an executor that runs
everything at once in this process."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any


class Here(Executor):
    """Runs what it is given before `submit` returns; raises what that raises."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def start(*words: str, **variables: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **variables},
    )


def worker(address: str) -> subprocess.Popen[bytes]:
    return start(
        *("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"),
        "--no-nanny",
    )


@contextmanager
def dask_cluster(workers: int = 0, variables: Mapping[str, str] | None = None) -> Iterator[str]:
    """The address of a scheduler.

    Args:
      workers: processes that fly for it.
      variables: of the scheduler's environment.
    """
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    scheduler = start(
        *("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port)),
        "--no-dashboard",
        **(variables or {}),
    )
    processes = [scheduler, *(worker(address) for _ in range(workers))]
    try:
        yield address
    finally:
        for process in processes:
            process.kill()
            process.wait()
