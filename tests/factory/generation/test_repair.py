"""Repair: whatever file of a store is damaged, it comes back bit for bit."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from trees import contents

from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.generation.rebuild import lost, repair
from factory.sampling.recipe import Recipe
from factory.store_check import check_files
from twin.errors import StoreError

Recipes = Callable[..., Recipe]


def flip(path: Path, share: float) -> None:
    data = bytearray(path.read_bytes())
    data[min(int(share * len(data)), len(data) - 1)] ^= 0x20
    path.write_bytes(bytes(data))


DAMAGED = (
    ("true_depth/c/0/0", 0.1, 1),  # one chunk: one mission flies again
    ("true_pitch/c/0/0", 1.0, 4),  # the index of the chunks: nobody knows where they are
    ("true_surge/zarr.json", 0.5, 0),
    ("mission_pitch_deg/c/0/0", 0.3, 0),  # drawn again
    ("n_samples/c/0", 0.5, 0),
    ("attempt/c/0", 0.2, 4),  # how often they failed is only known by flying
    ("zarr.json", 0.3, 0),
    ("recipe/zarr.json", 0.5, 0),
    ("checksums/zarr.json", 0.5, 4),
)


@pytest.mark.parametrize(("name", "share", "flown"), DAMAGED)
def test_a_flipped_byte_is_found_and_made_again(
    tmp_path: Path, paper_store: Path, name: str, share: float, flown: int
) -> None:
    store = tmp_path / "missions.zarr"
    shutil.copytree(paper_store, store)
    flip(store / name, share)
    done = repair(store)
    assert name in done.damaged
    assert len(done.flown) == flown
    assert contents(store) == contents(paper_store)
    assert [path.name for path in tmp_path.iterdir()] == ["missions.zarr"]


def test_what_is_gone_and_what_is_foreign_is_put_right(tmp_path: Path, paper_store: Path) -> None:
    store = tmp_path / "missions.zarr"
    shutil.copytree(paper_store, store)
    shutil.rmtree(store / "true_roll")
    (store / "true_depth" / "note.txt").write_text("mine")
    assert len(check_files(store).problems) == 3
    assert set(repair(store).damaged) >= {"true_roll/c/0/0", "true_depth/note.txt"}
    assert contents(store) == contents(paper_store)
    assert repair(store).damaged == ()


def test_what_no_copy_of_the_recipe_is_left_of_is_refused(
    tmp_path: Path, paper_store: Path
) -> None:
    store = tmp_path / "missions.zarr"
    shutil.copytree(paper_store, store)
    for name in ("zarr.json", "recipe/zarr.json"):
        (store / name).write_text("{")
    before = contents(store)
    with pytest.raises(StoreError, match="its recipe cannot be read"):
        repair(store)
    assert contents(store) == before


def test_failed_attempts_come_back_too(tmp_path: Path, made_with_failures: Path) -> None:
    store = tmp_path / "missions.zarr"
    shutil.copytree(made_with_failures, store)
    flip(store / "failure_reason" / "c" / "0", 0.9)
    flown = repair(store).flown
    assert 0 < len(flown) == (GeneratedStore(store).array("attempt") > 0).sum()
    assert contents(store) == contents(made_with_failures)


@pytest.fixture(scope="module")
def made_with_failures(tmp_path_factory: pytest.TempPathFactory, recipe: Recipes) -> Path:
    store = tmp_path_factory.mktemp("failures") / "missions.zarr"
    generate(recipe(changes={"vehicle.k_beta": "choice(1, 400)"}), store, workers=1)
    return store


def test_stores_that_no_recipe_makes_are_told(tmp_path: Path, paper_store: Path) -> None:
    assert lost(paper_store) is None
    with pytest.raises(StoreError, match="no store at"):
        lost(tmp_path / "none.zarr")
