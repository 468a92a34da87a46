"""Dask: a scheduler on this machine, and workers that come and go."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from factory.generation.generation import generate
from factory.sampling.recipe import Recipe

WORKER = ("--no-dashboard", "--no-nanny", "--nthreads", "1")


class Dask:
    """Workers of the scheduler at an address."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.workers: list[subprocess.Popen[bytes]] = []

    def join(self) -> None:
        """Start a worker."""
        self.workers.append(_start("distributed.cli.dask_worker", self.address, *WORKER))

    def lose(self, place: int) -> None:
        """Kill a worker."""
        process = self.workers.pop(place)
        process.kill()
        process.wait()

    def generate(self, recipe: Recipe, store: Path, *, resume: bool = False) -> None:
        """Have the workers make a store; for a process of its own, which then has threads."""
        from factory.generation.executors import dask_executor

        with dask_executor(self.address) as executor:
            generate(recipe, store, executor=executor, resume=resume)


@contextlib.contextmanager
def dask_cluster(workers: int) -> Iterator[Dask]:
    """A scheduler with so many workers to begin with."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    place = ("--host", "127.0.0.1", "--port", str(port))
    scheduler = _start("distributed.cli.dask_scheduler", *place, "--no-dashboard")
    cluster = Dask(f"tcp://127.0.0.1:{port}")
    try:
        for _ in range(workers):
            cluster.join()
        yield cluster
    finally:
        for process in (*cluster.workers, scheduler):
            process.kill()
            process.wait()


def _start(*words: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
