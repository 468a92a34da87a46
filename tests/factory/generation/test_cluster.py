"""A dask cluster that is not there, is lost or has another version is told. That it makes the bytes
of one process, also when a worker is lost, `tests/benchmarks/test_histories.py` tests."""

import concurrent.futures
import contextlib
import os
import time

import pytest
from clusters import dask_cluster, free_port
from patience import HANG_S

import factory
from factory.generation import executors as cluster
from factory.generation.executors import dask_executor
from factory.generation.job import Job
from factory.generation.shard import fly_shard
from twin.errors import InputError, StoreError, TwinError

pytest.importorskip("distributed", reason='needs pip install "glider-twin[cluster]"')


@pytest.fixture
def address():
    with dask_cluster() as found:
        yield found


def test_nobody_at_the_address_is_told(monkeypatch):
    monkeypatch.setattr("factory.generation.executors.TIMEOUT_S", 0.5)
    for address in (f"tcp://127.0.0.1:{free_port()}", "nonsense://x", "tcp://"):
        with (
            pytest.raises(InputError, match=r"--scheduler .* no dask scheduler answers"),
            dask_executor(address),
        ):
            pass


def test_a_task_that_ends_its_workers_is_told():
    """Too little memory does so."""
    allowed = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    with (
        dask_cluster(1, allowed) as address,
        pytest.raises(TwinError, match=r"the cluster was lost \(.*--resume goes on") as told,
        dask_executor(address) as executor,
    ):
        executor.submit(os._exit, 1).result(HANG_S)
    assert "\n" not in str(told.value)


def test_a_scheduler_that_ends_is_told():
    def work():
        with contextlib.ExitStack() as cluster:
            address = cluster.enter_context(dask_cluster(1))
            with dask_executor(address) as executor:
                future = executor.submit(time.sleep, 10 * HANG_S)
                cluster.close()
                concurrent.futures.wait([future], HANG_S)
                future.result(0)

    with pytest.raises(TwinError, match=r"the cluster was lost \(its scheduler is gone\)"):
        work()


def test_workers_of_another_version_are_told_before_they_fly(address, monkeypatch, tmp_path):
    monkeypatch.setattr(cluster, "WORKERS_S", 0.1)
    monkeypatch.setattr(cluster, "__version__", "99.0")
    with (
        pytest.warns(UserWarning, match="has no workers yet"),
        pytest.raises(InputError, match=r"needs glider-twin 99\.0 .*: the scheduler has \(\d"),
    ):
        factory.generate(tmp_path / "missions.zarr", scheduler=address)


def test_a_worker_that_does_not_see_the_folder_says_so(recipe, tmp_path):
    made = recipe()
    with pytest.raises(StoreError, match=r"does not see .*missions\.zarr\.generating"):
        fly_shard(Job(made, tmp_path / "missions.zarr"), 0)
    assert not list(tmp_path.iterdir())
