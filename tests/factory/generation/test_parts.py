"""Parts of a job array: one hash of the tree however many commands make it, in whatever order."""

import itertools
import subprocess
import sys

import pytest
from patience import HANG_S
from trees import contents

from factory.generation.job import Job, Layout
from factory.generation.parts import StorePart, finish, generate_part, parse_part, slurm_part
from twin.errors import InputError, StoreError
from twin.records.store import open_store


@pytest.mark.parametrize("abreast", [1, 64])
@pytest.mark.parametrize("missions", [1, 3, 13, 64, 65, 1333, 13_333, 1_000_000])
def test_shards_fill_the_store(missions, abreast):
    layout = Layout(missions, abreast)
    spans = [layout.missions_of(shard) for shard in layout.shards]
    assert spans[0].start == 0
    assert spans[-1].stop == missions
    assert all(one.stop == other.start for one, other in itertools.pairwise(spans))
    assert min(3, missions) <= len(spans) <= 192
    signals, rows = 75, 180  # more than preset field has
    chunks = -(-missions // layout.row_missions)
    assert signals * len(layout.shards) + rows * chunks + signals + rows < 20_000


def test_parts_in_any_order_make_the_store(tmp_path, recipe, paper_store):
    """Tasks of Slurm that run again are an array of their own, with another count."""

    def part(task, count, first):
        names = ("SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", "SLURM_ARRAY_TASK_MIN")
        found = slurm_part(dict(zip(names, map(str, (task, count, first)), strict=True)))
        assert found is not None
        return found

    made, store = recipe(), tmp_path / "missions.zarr"
    for task in (3, 1):
        assert generate_part(made, store, part(task, 3, 1))[0] > 0
    with pytest.raises(StoreError, match=r"is incomplete.*--resume"):
        open_store(store)
    message = r"1 of 4 missions .* run these parts of 3 again: --array=2$"
    with pytest.raises(StoreError, match=message):
        finish(store)
    assert generate_part(made, store, part(3, 3, 1)) == (0, 1)
    generate_part(made, store, part(2, 1, 2))
    summary, same = finish(store)
    assert same.digest == made.digest
    assert summary.missions == len(made.plan)
    assert contents(store) == contents(paper_store)
    assert finish(store)[0].flown == 0  # once more is harmless
    assert generate_part(made, store, part(1, 3, 1)) == (0, 0)
    assert slurm_part({}) is None
    with pytest.raises(InputError, match="SLURM_ARRAY_TASK_COUNT"):
        slurm_part({"SLURM_ARRAY_TASK_ID": "3"})


def test_eight_commands_at_once_make_the_same_bytes(tmp_path, recipe, paper_store):
    store = tmp_path / "missions.zarr"
    changes = [f"{name}={text}" for name, text in recipe().changes.items()]
    command = [sys.executable, "-m", "factory", "generate", "--hours", "0.2", "--out", str(store)]
    commands = [
        subprocess.Popen([*command, "--shard", f"{i}/4", "--set", *changes], stderr=subprocess.PIPE)
        for i in (0, 1, 2, 3, 3)  # the last part twice
    ]
    for process in commands:
        _, said = process.communicate(timeout=HANG_S)
        assert process.returncode == 0, said
    finish(store)
    assert contents(store) == contents(paper_store)
    log = (tmp_path / "missions.zarr.log").read_text()
    assert log.count("--shard") == len(commands)


def test_a_part_that_there_is_not_is_refused(tmp_path, recipe):
    made, store = recipe(), tmp_path / "missions.zarr"
    with pytest.raises(StoreError, match="was not begun"):
        finish(store)
    generate_part(made, store, StorePart(0, 2))
    with pytest.raises(InputError, match="was begun in 2 parts, 0 to 1"):
        generate_part(made, store, StorePart(5, 8))
    with pytest.raises(StoreError, match=r"other settings \(seed: 0 -> 1\)"):
        generate_part(recipe(seed=1), store, StorePart(1, 2))
    assert Job(made, store).files.exists("recipe.json")


@pytest.mark.parametrize("text", ["3", "8/8", "-1/4", "1/0", "a/b", "1/2/3", ""])
def test_a_wrong_part_is_refused(text):
    with pytest.raises(InputError, match=r"--shard"):
        parse_part(text)
    assert parse_part("0/8") == StorePart(0, 8)
