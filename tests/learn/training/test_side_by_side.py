"""Side by side: networks of a run through any executor, and what is left behind."""

from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from learn_missions import write_synthetic_store

import learn.training.workers as side_by_side
from learn.networks.base import NetworkConfig
from learn.run import METRICS
from learn.training.fit_config import FitConfig
from learn.training.fitting import fit
from learn.training.optimiser import TrainingConfig
from learn.training.resources import Resources, training_resources
from twin.errors import InputError, StoreError, TwinError


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("side")
    return write_synthetic_store(folder / "s.zarr", [300, 280, 260, 270], [0, 0, 1, 2])


def config_of(store, seed=0, **changes):
    return FitConfig(
        store=str(store),
        features=("sin_pitch", "depth_rate"),
        network=NetworkConfig(kind="elman", hidden=4, layers=1),
        training=TrainingConfig(epochs=2, seconds=0.0, seed=seed, validations=4),
        **changes,
    )


def weights(folder):
    return {p.name: p.read_bytes() for p in sorted(Path(folder).glob("*.safetensors"))}


def test_any_executor_trains_what_one_process_trains(store, tmp_path):
    alone = fit(config_of(store), tmp_path / "alone")
    seen = []
    with (
        ThreadPoolExecutor(2) as threads,
        training_resources(executor=threads, memory=1.0) as resources,
    ):
        run = fit(
            config_of(store), tmp_path / "run", resources, watch=lambda *found: seen.append(found)
        )
    assert weights(run.folder) == weights(alone.folder)
    assert run.description["complete"]
    assert len(seen) == len(run.metrics()) == len(alone.metrics())
    ours, theirs = (
        sorted(
            [{k: v for k, v in row.items() if k != "seconds"} for row in one.metrics()],
            key=lambda row: (row["network"], row["step"]),
        )
        for one in (run, alone)
    )
    assert ours == theirs
    assert [p.name for p in run.folder.iterdir() if p.name.startswith(".")] == []


class Lost(Executor):
    """Runs each task, after an attempt of a worker that is lost in the middle of a report."""

    def submit(self, function, task, *rest):
        future = Future()
        with task.reports.open("a") as file:
            file.write('{"step": 1, "epo')
        try:
            future.set_result(function(task, *rest))
        except BaseException as error:  # as an executor does
            future.set_exception(error)
        return future


def test_half_a_report_of_a_lost_worker_is_left_out(store, tmp_path):
    run = fit(config_of(store), tmp_path / "run", Resources(Lost()))
    assert {row["network"] for row in run.metrics()} == {"surge-0", "sway-0"}
    assert all(row["epoch"] > 0 for row in run.metrics())


def test_a_task_ends_when_its_start_has_ended(store, tmp_path, monkeypatch):
    real = side_by_side.train

    def interrupted(job, folder, report, **options):
        (folder / side_by_side.WORD).unlink(missing_ok=True)  # as the end of a start does
        return real(job, folder, report, **options)

    monkeypatch.setattr("learn.training.workers.train", interrupted)
    with pytest.raises(TwinError, match=r"the fit of s[a-z]*-0 in .*run has ended"):
        fit(config_of(store), tmp_path / "run", Resources(Lost()))


def test_what_stops_a_task_stops_the_others_and_keeps_its_kind(store, tmp_path):
    class Refusing(Lost):
        def submit(self, function, task, *rest):
            future = Future()
            if task.job.target == "sway":
                future.set_exception(StoreError("no such mission"))
                return future
            return super().submit(function, task, *rest)

    with pytest.raises(StoreError, match="no such mission"):
        fit(config_of(store), tmp_path / "run", Resources(Refusing()))
    assert [p.name for p in (tmp_path / "run").glob(".*")] == []
    done = fit(config_of(store), tmp_path / "run", resume=True)
    assert done.description["complete"]


def test_workers_and_an_executor_are_one_too_many():
    with (
        pytest.raises(InputError, match="either workers or an executor"),
        training_resources(2, Lost()),
    ):
        pass


def test_a_dask_cluster_trains_what_one_process_trains(store, tmp_path):
    distributed = pytest.importorskip("distributed", reason='needs "glider-twin[cluster]"')
    alone = fit(config_of(store), tmp_path / "alone")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        executor = client.get_executor(pure=False)
        run = fit(config_of(store), tmp_path / "run", Resources(executor))
    assert weights(run.folder) == weights(alone.folder)
    assert (run.folder / METRICS).stat().st_size > 0
