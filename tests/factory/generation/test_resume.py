"""What a resumed run says that it flew, and what the workers of a killed run leave behind."""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from patience import HANG_S
from stores import missions_kept
from trees import contents

import factory.generation.generation
from factory.generation.generation import generate
from factory.generation.job import MOST_IN_SHARD, Job, locked
from factory.generation.parts import StorePart, finish, generate_part
from factory.generation.target import unfinished
from twin.errors import StoreError
from twin.records.presence import generating

FLOWN_AGAIN = (0, 2)
"""missions whose markers are lost before the resume"""


def test_a_job_travels_without_what_its_process_has_opened(tmp_path, recipe):
    """A pool's thread pickles it while the process that flies opens its files."""
    job = Job(recipe(), tmp_path / "missions.zarr")
    assert job.files
    assert job.tree
    copy = pickle.loads(pickle.dumps(job))
    assert set(vars(copy)) == {"store", "digest", "_text"}
    assert (copy.store, copy.digest) == (job.store, job.digest)
    assert copy.recipe is job.recipe  # of a process that has it


def test_a_resumed_run_counts_only_what_it_flew_itself(tmp_path, recipe, monkeypatch):
    made, store = recipe(), tmp_path / "missions.zarr"

    def stop(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(factory.generation.generation, "complete", stop)
        with pytest.raises(KeyboardInterrupt):
            generate(made, store, workers=1)
    with pytest.raises(StoreError, match="is incomplete: --resume completes it"):
        generate(made, store, workers=1)
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


def test_what_an_older_program_began_is_refused(tmp_path, recipe, paper_store):
    """It kept blocks of missions, which nothing reads any more."""
    made, store = recipe(), tmp_path / "missions.zarr"
    job = Job(made, store)
    job.begin()
    job.files.write("blocks/000000.json", b"{}")
    assert unfinished(store).missions_kept == 0
    for work in (
        lambda: generate(made, store, workers=1, resume=True),
        lambda: generate(made, store, workers=1),
        lambda: generate_part(made, store, StorePart(0, 2)),
        lambda: finish(store),
    ):
        with pytest.raises(StoreError, match=r"begun by an older glider-twin .*--overwrite starts"):
            work()
    generate(made, store, workers=1, overwrite=True)
    assert contents(store) == contents(paper_store)


def workers_of(process):
    """Process numbers of its children."""
    return [int(n) for n in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def lives(process):
    """Whether it runs; one that has ended and waits to be collected does not."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def wait_until(condition, seconds=HANG_S):
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
        wait_until(lambda: process.poll() is not None or missions_kept(store) >= 1)
        assert process.poll() is None
        left = workers_of(process.pid)
        assert len(left) == 2
        for worker in left:
            os.kill(worker, signal.SIGSTOP)
        process.kill()
        process.wait()
        assert all(lives(worker) for worker in left)
        with locked(store):  # refused while another run holds it
            kept = missions_kept(store)
        for worker in left:
            os.kill(worker, signal.SIGCONT)
        wait_until(lambda: not any(lives(worker) for worker in left))
        # each may finish the shard that it was flying
        assert missions_kept(store) <= kept + 2 * MOST_IN_SHARD
    finally:
        process.kill()
        process.wait()
        for worker in filter(lives, left):
            os.kill(worker, signal.SIGKILL)
