"""What lies in the folder of an unfinished store is read within limits, whatever it holds."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import factory.sampling.fly
from factory.__main__ import PROGRAM
from factory.generation.attempts import fly_missions
from factory.generation.executors import Job
from factory.generation.manifest import Manifest, missions_kept, read_manifest
from factory.generation.mission_block import TABLE, Block
from factory.generation.parts import ARRAY, StorePart, generate_part
from factory.generation.site import Site
from factory.generation.target import recipe_begun
from factory.sampling.recipe import Recipe
from twin.errors import FloorError, NoSteadyState, StoreError
from twin.records.presence import read_attributes
from twin.records.storage.stored_files import GiantFile, LocalFiles
from twin.records.store import open_store

Recipes = Callable[..., Recipe]
GIANT = 200 * 2**20


def sparse(path: Path, size: int = GIANT) -> Path:
    """A file that declares many bytes and has none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.truncate(size)
    return path


def test_a_giant_file_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, recipe = tmp_path / "store.zarr", tmp_path / "recipe"
    sparse(store / "zarr.json")
    sparse(recipe / "recipe.json")
    monkeypatch.setattr(LocalFiles, "read", lambda *_: pytest.fail("it is read"))
    for read in (read_attributes, open_store):
        with pytest.raises(StoreError, match="no such file needs"):
            read(store)
    with pytest.raises(StoreError, match="is damaged"):
        recipe_begun(recipe)
    sparse(tmp_path / "manifest.json")
    assert read_manifest(LocalFiles(tmp_path), "manifest.json", unit="u", recipe="r") is None
    with pytest.raises(GiantFile, match="no such file needs"):
        LocalFiles(tmp_path).read_small("manifest.json")


@pytest.mark.parametrize("version", ["1e999", '"x"', "null", "[]"])
def test_a_version_that_is_none_is_refused(tmp_path: Path, version: str) -> None:
    text = '{"zarr_format": 3, "node_type": "group", "attributes": {"schema_version": %s}}'
    (tmp_path / "zarr.json").write_text(text % version)
    with pytest.raises(StoreError, match="does not say its schema_version"):
        open_store(tmp_path)


def test_missions_of_manifests_are_counted_without_being_listed(
    tmp_path: Path, recipe: Recipes
) -> None:
    site = Site(tmp_path / "missions.zarr", recipe().digest)
    for name, first, last in (("blocks/0", 0, 3), ("shards/0", 0, 7), ("blocks/1", 9, 10**15)):
        site.files.write(f"{name}.json", json.dumps({"first": first, "last": last}).encode())
    site.files.write("blocks/2.json", b'{"first": 1e999, "last": 0}')
    site.files.write("blocks/3.json", b"[" * 100_000)
    assert missions_kept(site) == 8 + 10**15 - 8


@pytest.mark.parametrize("text", ["{}", '{"first": 0, "count": 0}', "[]", "[" * 100_000])
def test_a_damaged_count_of_parts_is_told(tmp_path: Path, recipe: Recipes, text: str) -> None:
    made, store = recipe(), tmp_path / "missions.zarr"
    generate_part(made, store, StorePart(0, 4))
    (Site(store, made.digest).folder / ARRAY).write_text(text)  # type: ignore[union-attr]
    with pytest.raises(StoreError, match=r"array\.json is damaged .*: remove it"):
        generate_part(made, store, StorePart(1, 4))


def bomb() -> bytes:
    """A small archive that declares a thousand times its size."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(f"{TABLE}.npy", bytes(GIANT * 2))
    return archive.getvalue()


def tables(**table: object) -> bytes:
    archive = io.BytesIO()
    text = json.dumps(table).encode()
    np.savez(archive, allow_pickle=False, **{TABLE: np.frombuffer(text, np.uint8)})
    return archive.getvalue()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (bomb, "made to fill the memory"),
        (lambda: b"PK", "cannot be read"),
        (tables, "is not a block"),
    ],
)
def test_a_block_of_somebody_else_is_refused(
    tmp_path: Path, recipe: Recipes, data: Callable[[], bytes], message: str
) -> None:
    made = recipe()
    job = Job(made, Site(tmp_path / "missions.zarr", made.digest))
    key = job.site.block(0)
    sums = {key: job.site.files.put(key, data())}
    manifest = Manifest(
        unit="block 0", recipe=made.digest, first=0, last=0, files=sums, failures=0, versions={}
    )
    with pytest.raises(StoreError, match=message):
        Block(job, manifest)


@pytest.mark.parametrize("error", [FloorError("the floor is too near"), NoSteadyState("it spins")])
def test_what_cannot_be_flown_is_replaced(
    recipe: Recipes, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    real, tried = factory.sampling.fly.build_scenario, []

    def build(*words: object) -> object:
        tried.append(words)
        if len(tried) == 1:
            raise error
        return real(*words)  # type: ignore[arg-type]

    monkeypatch.setattr(factory.sampling.fly, "build_scenario", build)
    ((flown, _),) = fly_missions(recipe(), [0])
    assert flown.attempt == 1
    assert flown.failures[0].reason == str(error)


@pytest.mark.parametrize("command", ["verify", "finish"])
@pytest.mark.parametrize("place", [".", "..", "/"])
def test_a_folder_without_its_name_is_answered(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    place: str,
) -> None:
    (tmp_path / "within").mkdir()
    monkeypatch.chdir(tmp_path / "within")
    assert PROGRAM.main([command, place]) == 2
    message = capsys.readouterr().err
    assert f"error: {place} " in message
    assert "bug" not in message
