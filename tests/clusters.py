"""A dask cluster of processes on this machine, started as people start it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


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
