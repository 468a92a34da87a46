"""A dask cluster makes the bytes that one process makes, also when a worker is lost."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from trees import contents

from factory.generation.cluster import dask_executor
from factory.generation.generate import generate
from factory.inspect.info import unfinished
from factory.recipe.recipe import Recipe
from twin.errors import InputError

pytest.importorskip("distributed", reason='needs pip install "glider-twin[cluster]"')

Recipes = Callable[..., Recipe]
WAIT_S = 60.0


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def start(*words: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def worker(address: str) -> subprocess.Popen[bytes]:
    return start(
        *("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"),
        "--no-nanny",
    )


@pytest.fixture
def address() -> Iterator[str]:
    port = free_port()
    scheduler = start(
        *("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port)),
        "--no-dashboard",
    )
    yield f"tcp://127.0.0.1:{port}"
    scheduler.kill()
    scheduler.wait()


def test_a_lost_worker_and_one_that_joins_change_no_byte(
    tmp_path: Path, recipe: Recipes, address: str
) -> None:
    made = recipe(hours=2.0)  # some forty missions, twenty blocks
    generate(made, tmp_path / "one.zarr", workers=1)
    store = tmp_path / "cluster.zarr"
    workers = [worker(address), worker(address)]
    try:
        with dask_executor(address) as executor:
            lost: list[int] = []

            def watch(hours: float, failures: int) -> None:
                begun = unfinished(store)
                if not lost and begun is not None and begun.missions_kept >= 4:
                    workers[0].kill()
                    workers.append(worker(address))
                    lost.append(begun.missions_kept)

            generate(made, store, executor=executor, watch=watch)
    finally:
        for process in workers:
            process.kill()
            process.wait()
    assert lost[0] < len(made.plan)
    assert contents(store) == contents(tmp_path / "one.zarr")


def test_nobody_at_the_address_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("factory.generation.cluster.TIMEOUT_S", 0.5)
    begun = time.monotonic()
    for address in (f"tcp://127.0.0.1:{free_port()}", "nonsense://x", "tcp://"):
        with (
            pytest.raises(InputError, match=r"--scheduler .* no dask scheduler answers"),
            dask_executor(address),
        ):
            pass
    assert time.monotonic() - begun < WAIT_S
