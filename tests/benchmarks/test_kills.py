"""A little of `python -m benchmarks.kills` and `python -m benchmarks.one_hash`."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from benchmarks.faults.injector import compiler
from benchmarks.kills.__main__ import CLUSTER, harm
from benchmarks.kills.kinds import KINDS, Ground
from benchmarks.kills.processes import small_recipe, wrong
from benchmarks.kills.versions import check_versions
from benchmarks.one_hash import hashes
from factory.generation.generation import generate

NEEDS_DASK = pytest.mark.skipif(find_spec("distributed") is None, reason="needs dask.distributed")
NEEDS_COMPILER = pytest.mark.skipif(compiler() is None, reason="the clock needs a C compiler")
MARKS = {CLUSTER: NEEDS_DASK, "clock-jumps": NEEDS_COMPILER}
HOURS = 0.3
"""Six missions"""


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Ground:
    return Ground.prepare(tmp_path_factory.mktemp("kills"), hours=HOURS)


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=MARKS.get(kind, ())) for kind in KINDS])
def test_no_harm_changes_a_byte(ground: Ground, kind: str) -> None:
    row = harm(ground, kind, 1)
    assert row["lost"] == []
    assert row["survived"] == 1


def test_a_store_that_is_not_the_same_is_noticed(ground: Ground, tmp_path: Path) -> None:
    store = tmp_path / "missions.zarr"
    assert wrong(store, ground.expected) == "there is no store"
    generate(small_recipe(HOURS), store, workers=1)
    assert wrong(store, ground.expected) is None
    (tmp_path / ".missions.zarr.writing-1").mkdir()
    assert wrong(store, ground.expected) == "left .missions.zarr.writing-1"
    (store / "zarr.json").write_bytes(b"{}")
    assert wrong(store, ground.expected) == "the store has other bytes"


@pytest.mark.filterwarnings("ignore:.*imported by version 1 of the readers")
def test_stores_of_other_versions_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    row = check_versions(tmp_path)
    assert row["lost"] == []
    assert row["survived"] == row["done"] > 10


@NEEDS_DASK
def test_every_way_gives_one_hash(tmp_path: Path) -> None:
    found = hashes(tmp_path, HOURS, kills=1)
    assert len(found) == 8
    assert len({value for _, value in found}) == 1, found
