"""Further missions: what a test split lacks is flown by the store's recipe with another seed."""

from pathlib import Path

import pytest

from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from learn.run import open_run
from learn.run_evaluation import evaluate_run, further_missions

SHORT = {"mission.duration_h": "uniform(0.1, 0.2)"}
RUN = Path(__file__).resolve().parents[2] / "data" / "e2ff189" / "run"
LEAST = 6


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    path = tmp_path_factory.mktemp("store") / "missions.zarr"
    generate(make_recipe(hours=0.6, seed=3, changes=SHORT), path, workers=1)
    return path


def test_the_lacking_missions_are_flown_with_a_seed_of_their_own(store, tmp_path):
    said: list[str] = []
    path = further_missions(store, "test", tmp_path, least=LEAST, say=said.append)
    assert path is not None
    own, more = GeneratedStore(store), GeneratedStore(path)
    assert len(more) + own.splits.count("test") >= LEAST
    assert more.seed != own.seed
    assert more.distributions == own.distributions
    assert "the store has 1 test mission" in said[0]
    # a second evaluation reads what is there
    before = {one: one.stat().st_mtime_ns for one in path.rglob("c/*") if one.is_file()}
    assert further_missions(store, "test", tmp_path, least=LEAST, say=said.append) == path
    assert {one: one.stat().st_mtime_ns for one in path.rglob("c/*") if one.is_file()} == before


@pytest.mark.parametrize(("split", "least"), [("test", 1), ("all", LEAST)])
def test_a_store_with_enough_missions_is_judged_alone(store, split, least, tmp_path):
    assert further_missions(store, split, tmp_path, least=least, say=pytest.fail) is None
    assert list(tmp_path.iterdir()) == []


def test_logs_and_single_flights_are_judged_alone(tmp_path, small_store):
    assert further_missions(small_store, "test", tmp_path, least=9, say=pytest.fail) is None


def test_further_missions_count_in_the_figures_and_are_not_drawn(store, tmp_path):
    path = further_missions(store, "test", tmp_path, least=LEAST, say=lambda text: None)
    count = len(GeneratedStore(path))
    seen: list[int] = []
    run = open_run(RUN)
    alone = evaluate_run(run, store, watches=[lambda one, found: seen.append(one.mission.index)])
    found = evaluate_run(run, store, further=path)
    assert len(seen) == alone.figures["missions"] == 1
    assert found.figures["further"] == count
    assert found.figures["missions"] == 1 + count
    assert found.figures["store"] == str(store)
    assert len(found.shown) == 1
    assert found.figures["uncertainty"] != alone.figures["uncertainty"]
