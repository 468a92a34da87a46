"""A little of `python -m benchmarks.histories`."""

from importlib.util import find_spec

import pytest

from benchmarks.histories import KINDS, Ground, fault_of, generate
from benchmarks.processes import done

NEEDS_DASK = pytest.mark.skipif(find_spec("distributed") is None, reason="needs dask.distributed")
MARKS = {"dask": NEEDS_DASK, "watch": pytest.mark.skip(reason="takes a minute")}


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    return Ground.prepare(tmp_path_factory.mktemp("histories"))


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=MARKS.get(kind, ())) for kind in KINDS])
def test_no_kill_loses_anything(ground, kind):
    assert KINDS[kind](ground, kind, 1) == []


def test_a_store_that_is_not_the_same_is_noticed(ground, tmp_path):
    store = tmp_path / "missions.zarr"
    assert fault_of(ground, store) == "there is no store"
    assert done(lambda: generate(ground.recipe, store, workers=1))
    (tmp_path / ".missions.zarr.writing-1").mkdir()
    assert fault_of(ground, store) == "left .missions.zarr.writing-1"
    (store / "zarr.json").write_bytes(b"{}")
    assert fault_of(ground, store) == "the store has other bytes"
