"""The contract of generate: same bytes for any executor, resumes, refusals, full disks, and what
the workers of a killed run leave behind. `test_histories` kills runs at any moment."""

import contextlib
import json
import os
import pickle
import resource
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
import pytest
from clusters import Here
from patience import HANG_S
from stores import missions_kept
from trees import contents

import factory.generation.generation
import factory.generation.shard
from factory.__main__ import PROGRAM
from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.generation.job import MOST_IN_SHARD, Job, locked, unfinished
from factory.generation.shard import fly_shard
from factory.soundness import replay_failure, verify_store
from twin.errors import InputError, StoreError, TwinError
from twin.records.presence import generating

FLOWN_AGAIN = (0, 2)
"""missions whose markers are lost before the resume"""


def test_every_file_is_on_the_disk_before_the_store_has_its_name(tmp_path, recipe, monkeypatch):
    synced, sync = set(), os.fsync

    def heard(descriptor):
        synced.add(os.fstat(descriptor).st_ino)
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", heard)
    store = tmp_path / "missions.zarr"
    generate(recipe(), store, executor=Here())
    assert all(path.stat().st_ino in synced for path in store.rglob("*") if path.is_file())


def test_any_executor_makes_the_same_bytes(tmp_path, recipe, paper_store):
    with ThreadPoolExecutor(3) as threads:
        generate(recipe(), tmp_path / "threads.zarr", executor=threads)
    assert contents(tmp_path / "threads.zarr") == contents(paper_store)
    with pytest.raises(StoreError, match="either workers or an executor"):
        generate(recipe(), tmp_path / "both.zarr", executor=Here(), workers=2)


def test_a_shard_of_another_recipe_is_never_taken(tmp_path, recipe, monkeypatch):
    mine, other = tmp_path / "mine.zarr", tmp_path / "other.zarr"
    _stop_before_completion(monkeypatch, recipe(), mine)
    _stop_before_completion(monkeypatch, recipe(seed=1), other)
    folders = [Job(one, store).folder for one, store in ((recipe(seed=1), other), (recipe(), mine))]
    shutil.copytree(*(folder / "done" for folder in folders), dirs_exist_ok=True)
    with pytest.raises(StoreError, match=rf"recipe {recipe(seed=1).digest[:12]}, expected") as told:
        generate(recipe(), mine, workers=1, resume=True)
    assert recipe().digest[:12] in str(told.value)


def test_a_shard_made_twice_with_other_bytes_is_told(tmp_path, recipe, monkeypatch):
    """Two kinds of processor in one cluster would do that."""
    made, store = recipe(), tmp_path / "missions.zarr"
    _stop_before_completion(monkeypatch, made, store)
    job = Job(made, store)
    before = contents(store.with_name(f"{store.name}.generating"))
    assert fly_shard(job, 0) == (0,) * len(job.layout.missions_of(0))  # the same bytes again
    fly = factory.generation.shard.fly_missions

    def rounded(*arguments):
        return [
            (flown, {**signals, "true_depth": signals["true_depth"] + np.float32(1e-3)})
            for flown, signals in fly(*arguments)
        ]

    monkeypatch.setattr(factory.generation.shard, "fly_missions", rounded)
    with pytest.raises(StoreError, match="shard 0 was made twice with different bytes"):
        fly_shard(job, 0)
    assert contents(store.with_name(f"{store.name}.generating")) == before


def _stop_before_completion(monkeypatch, made, store, **options):
    def stop(*arguments):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(factory.generation.generation, "complete", stop)
        with pytest.raises(KeyboardInterrupt):
            generate(made, store, workers=1, **options)


def test_an_existing_store_is_only_replaced_when_told(recipe, copied):
    before = contents(copied)
    with pytest.raises(StoreError, match="already exists; use --overwrite"):
        generate(recipe(seed=1), copied, workers=1)
    assert contents(copied) == before
    generate(recipe(seed=1), copied, workers=1, overwrite=True)
    assert GeneratedStore(copied).seed == 1


def test_a_folder_that_is_no_store_is_never_touched(tmp_path, recipe):
    (tmp_path / "thesis.txt").write_text("years of work")
    for options in ({}, {"overwrite": True}, {"resume": True}):
        with pytest.raises(StoreError, match="exists and is not a store"):
            generate(recipe(), tmp_path, workers=1, **options)
    assert (tmp_path / "thesis.txt").read_text() == "years of work"
    assert list(tmp_path.iterdir()) == [tmp_path / "thesis.txt"]


@pytest.mark.parametrize(
    ("settings", "difference"),
    [
        ({"seed": 3}, "seed: 0 -> 3"),
        ({"hours": 0.3}, "hours: 0.2 -> 0.3"),
        ({"sensors": "field"}, "sensors."),
        ({"current": "uniform:0.1,0"}, "current: None -> "),
        (
            {"changes": {"mission.pitch_deg": "uniform(20, 30)"}},
            "distributions.mission.pitch_deg: uniform(15, 45) except (28, 32) -> uniform(20, 30)",
        ),
    ],
)
def test_resume_with_other_settings_is_refused_with_the_difference(
    tmp_path, recipe, paper_store, monkeypatch, settings, difference
):
    begun = tmp_path / "begun.zarr"
    _stop_before_completion(monkeypatch, recipe(), begun)
    for store in (paper_store, begun):
        with pytest.raises(StoreError, match="started with other settings") as caught:
            generate(recipe(**settings), store, workers=1, resume=True)
        assert difference in str(caught.value)
        assert "\n" not in str(caught.value)
    assert GeneratedStore(paper_store).seed == 0


@contextlib.contextmanager
def largest_file(size):
    """Writing more than `size` bytes into a file fails, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("size", [2_000, 20_000, 60_000])
def test_a_full_disk_is_told_and_leaves_a_store_to_resume(tmp_path, recipe, paper_store, size):
    store = tmp_path / "missions.zarr"
    # 2 000 bytes stop the recipe, 20 000 and 60 000 the shards
    with largest_file(size), pytest.raises(StoreError, match=r"cannot write .*--resume") as caught:
        generate(recipe(), store, workers=2)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.rglob(".*.*"))  # no half-written files are left behind
    generate(recipe(), store, workers=2, resume=True)
    assert contents(store) == contents(paper_store)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_an_unwritable_folder_is_told(tmp_path, recipe):
    tmp_path.chmod(0o500)
    with pytest.raises(StoreError, match="cannot write"):
        generate(recipe(), tmp_path / "missions.zarr", workers=1)


def test_a_path_through_a_file_is_told(tmp_path, recipe):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match=r"cannot write .*Not a directory"):
        generate(recipe(), tmp_path / "file" / "missions.zarr", workers=1)


def test_two_runs_cannot_write_one_store(tmp_path, recipe):
    store = tmp_path / "missions.zarr"
    with locked(store):
        with pytest.raises(StoreError, match="another run is generating"):
            generate(recipe(), store, workers=1, resume=True)
        with pytest.raises(StoreError, match="another run is generating"):
            generate(recipe(), store, workers=1, overwrite=True)
    assert generate(recipe(), store, workers=1, resume=True).flown == len(recipe().plan)


@pytest.mark.parametrize("workers", [0, -1])
def test_impossible_workers_are_refused(tmp_path, recipe, workers):
    with pytest.raises(InputError, match="must be at least 1"):
        generate(recipe(), tmp_path / "missions.zarr", workers=workers)
    assert list(tmp_path.iterdir()) == []


def test_an_unstable_mission_is_recorded_replaced_and_counted(tmp_path, recipe):
    """A side force too stiff for the step throws the glider about."""
    made = recipe(changes={"vehicle.k_beta": "choice(1, 400)"})
    store = tmp_path / "missions.zarr"
    heard: list[int] = []
    summary = generate(made, store, workers=1, watch=lambda hours, failed: heard.append(failed))
    run = GeneratedStore(store)
    failures = run.failures()
    assert summary.failed == len(failures) == sum(heard) > 0
    assert run.array("attempt").sum() == len(failures)
    for failure in failures:
        drawn = run.recipe.parameters(failure.mission, failure.attempt).values
        assert drawn["vehicle.k_beta"] == 400.0
        assert failure.time_s == 0.0
        assert "timestep 0.1 s is too long" in failure.reason
        warn = mujoco.get_mju_user_warning()
        then, now = replay_failure(run, failure.mission, failure.attempt)
        assert mujoco.get_mju_user_warning() is warn  # silenced for the replay only
        assert then == now
    assert "vehicle_k_beta" not in run.dataset or set(run.array("vehicle_k_beta")) == {1.0}
    assert verify_store(run).ok
    with pytest.raises(StoreError, match="did not fail; failures in the store"):
        replay_failure(run, failures[0].mission, 19)


def test_a_value_that_was_set_is_an_array_of_the_store(tmp_path, recipe):
    generate(recipe(changes={"current.speed": "0.3"}), tmp_path / "missions.zarr", workers=1)
    speeds = GeneratedStore(tmp_path / "missions.zarr").array("current_speed")
    assert speeds.size > 0
    assert set(speeds) == {0.3}


def test_a_mission_that_never_flies_ends_the_run(tmp_path, recipe):
    made = recipe(changes={"mission.pitch_deg": "2"})
    store = tmp_path / "missions.zarr"
    with pytest.raises(InputError, match=r"failed 20 times, last: .*too shallow") as told:
        generate(made, store, workers=2)
    assert "narrow with --set: mission.pitch_deg (now 2)" in str(told.value)
    assert told.value.exit_code == 2
    assert unfinished(store) is not None
    generate(recipe(), store, workers=1)  # the corrected command, without --overwrite
    assert not generating(store).exists()


def test_a_dead_worker_is_told(tmp_path, recipe, monkeypatch):
    monkeypatch.setattr(
        factory.generation.shard, "fly_missions", lambda *_: os.kill(os.getpid(), signal.SIGKILL)
    )
    with pytest.raises(TwinError, match=r"a worker process ended abruptly.*--resume"):
        generate(recipe(), tmp_path / "missions.zarr", workers=2)


def test_a_bug_in_a_worker_keeps_its_traceback(tmp_path, recipe, monkeypatch):
    def fail(*_):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(factory.generation.shard, "fly_missions", fail)
    with pytest.raises(ZeroDivisionError, match="a bug") as caught:
        generate(recipe(), tmp_path / "missions.zarr", workers=1)
    assert "in fail" in str(caught.value.__cause__)


def test_an_interrupt_keeps_what_is_finished_and_says_how_to_go_on(tmp_path):
    store = tmp_path / "missions.zarr"
    command = [sys.executable, "-m", "factory", "generate", "--hours", "100", "--workers", "2"]
    process = subprocess.Popen(
        [*command, "--out", str(store)],
        stderr=subprocess.PIPE,
        start_new_session=True,
        # a test run started in the background of a shell inherits an ignored SIGINT
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    _wait_until(lambda: missions_kept(store) >= 2)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: parent and workers
    _, error = process.communicate(timeout=HANG_S)
    assert process.returncode == 130
    assert b"--resume" in error
    assert b"Traceback" not in error
    assert len(error.splitlines()) == 1
    assert missions_kept(store) >= 2


def test_an_overwrite_that_was_stopped_is_resumed(recipe, paper_store, monkeypatch, copied):
    _stop_before_completion(monkeypatch, recipe(seed=1), copied, overwrite=True)
    assert contents(copied) == contents(paper_store)
    with pytest.raises(StoreError, match="--overwrite --resume completes that"):
        generate(recipe(seed=1), copied, workers=1, resume=True)
    summary = generate(recipe(seed=1), copied, workers=1, resume=True, overwrite=True)
    assert summary.flown == 0
    assert GeneratedStore(copied).seed == 1


def test_a_job_travels_without_what_its_process_has_opened(tmp_path, recipe):
    """A pool's thread pickles it while the process that flies opens its files."""
    job = Job(recipe(), tmp_path / "missions.zarr")
    assert job.files
    assert job.tree
    copy = pickle.loads(pickle.dumps(job))
    assert set(vars(copy)) == {"store", "digest", "_text"}
    assert (copy.store, copy.digest) == (job.store, job.digest)
    assert copy.recipe is job.recipe  # of a process that has it


def test_a_resumed_run_counts_only_what_it_flew_itself(tmp_path, recipe, monkeypatch, capsys):
    made, store = recipe(), tmp_path / "missions.zarr"
    _stop_before_completion(monkeypatch, made, store)
    with pytest.raises(StoreError, match="is incomplete: --resume completes it"):
        generate(made, store, workers=1)
    assert PROGRAM.main(["info", str(store), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["complete"], told["missions_kept"]) == (False, len(made.plan))
    markers = sorted((Job(made, store).folder / "done").iterdir())
    assert len(markers) == len(made.plan) > len(FLOWN_AGAIN)
    for mission in FLOWN_AGAIN:
        markers[mission].unlink()
    hours = [duration / 3600.0 for duration in made.plan.durations_s]
    heard: list[float] = []
    summary = generate(
        made, store, workers=1, resume=True, watch=lambda done, _: heard.append(done)
    )
    assert summary.flown == len(FLOWN_AGAIN)
    assert summary.flown_hours == pytest.approx(sum(hours[m] for m in FLOWN_AGAIN))
    assert summary.hours == pytest.approx(sum(hours))
    assert summary.times_real_time == pytest.approx(
        summary.flown_hours * 3600.0 / summary.wall_s, rel=1e-12
    )
    # the progress bar hears of every mission once: of those that were there first
    kept = [hour for mission, hour in enumerate(hours) if mission not in FLOWN_AGAIN]
    assert heard[: len(kept)] == pytest.approx(kept)
    assert sorted(heard) == pytest.approx(sorted(hours))
    again = generate(made, store, workers=1, resume=True)
    assert (again.flown, again.flown_hours) == (0, 0.0)
    assert again.missions == len(made.plan)


def test_what_a_run_of_another_recipe_left_as_it_began_goes(tmp_path, recipe):
    store = tmp_path / "missions.zarr"
    left = Job(recipe(seed=1), store).folder
    left.mkdir(parents=True)
    (left / ".recipe.json.writing-0123abcd").touch()
    generate(recipe(), store, workers=1)
    assert not generating(store).exists()


def _workers_of(process):
    """Process numbers of its children."""
    return [int(n) for n in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def _lives(process):
    """Whether it runs; one that has ended and waits to be collected does not."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def _wait_until(condition, seconds=HANG_S):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="reads /proc, which Linux has")
def test_workers_whose_run_is_killed_end_and_never_hold_the_store(tmp_path):
    """A stopped worker outlives its parent; the store is free all the same, and then it ends."""
    store = tmp_path / "missions.zarr"
    command = [sys.executable, "-m", "factory", "generate", "--hours", "100", "--workers", "2"]
    process = subprocess.Popen(
        [*command, "--out", str(store)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    left: list[int] = []
    try:
        _wait_until(lambda: process.poll() is not None or missions_kept(store) >= 1)
        assert process.poll() is None
        left = _workers_of(process.pid)
        assert len(left) == 2
        for worker in left:
            os.kill(worker, signal.SIGSTOP)
        process.kill()
        process.wait()
        assert all(_lives(worker) for worker in left)
        with locked(store):  # refused while another run holds it
            kept = missions_kept(store)
        for worker in left:
            os.kill(worker, signal.SIGCONT)
        _wait_until(lambda: not any(_lives(worker) for worker in left))
        # each may finish the shard that it was flying
        assert missions_kept(store) <= kept + 2 * MOST_IN_SHARD
    finally:
        process.kill()
        process.wait()
        for worker in filter(_lives, left):
            os.kill(worker, signal.SIGKILL)
