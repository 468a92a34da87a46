"""What lies in the folder of an unfinished store is read within limits, whatever it holds."""

import hashlib

import pytest

import factory.sampling.fly
from factory.__main__ import PROGRAM
from factory.generation.completion import FailedAttempt, FlownMission, Marker, read_marker
from factory.generation.job import Job, missions_kept, recipe_begun
from factory.generation.parts import ARRAY, StorePart, generate_part
from factory.generation.shard import fly_missions
from factory.sampling.draw import Parameters
from twin.errors import FloorError, NoSteadyState, StoreError
from twin.records.presence import read_attributes
from twin.records.storage.store_path import Files, FileSum, GiantFile
from twin.records.store import open_store

GIANT = 200 * 2**20


def sparse(path, size=GIANT):
    """A file that declares many bytes and has none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.truncate(size)
    return path


def test_a_giant_file_is_not_read(tmp_path, monkeypatch):
    store, recipe = tmp_path / "store.zarr", tmp_path / "recipe"
    sparse(store / "zarr.json")
    sparse(recipe / "recipe.json")
    monkeypatch.setattr(Files, "read", lambda *_: pytest.fail("it is read"))
    for read in (read_attributes, open_store):
        with pytest.raises(StoreError, match="no such file needs"):
            read(store)
    with pytest.raises(StoreError, match="is damaged"):
        recipe_begun(recipe)
    sparse(tmp_path / "array.json")
    with pytest.raises(GiantFile, match="no such file needs"):
        Files(tmp_path).read_small("array.json")


@pytest.mark.parametrize("version", ["1e999", '"x"', "null", "[]"])
def test_a_version_that_is_none_is_refused(tmp_path, version):
    text = '{"zarr_format": 3, "node_type": "group", "attributes": {"schema_version": %s}}'
    (tmp_path / "zarr.json").write_text(text % version)
    with pytest.raises(StoreError, match="does not say its schema_version"):
        open_store(tmp_path)


def test_missions_kept_are_those_that_markers_name(tmp_path, recipe):
    job = Job(recipe(), tmp_path / "missions.zarr")
    names = ("0000000-0000003", "0000004-0000007", "0000009-999999999999", "0000005-0000002", "x")
    for name in names:
        job.files.write(f"done/{name}", b"")
    assert missions_kept(job.folder) == 8 + 10**12 - 9


@pytest.mark.parametrize("text", ["{}", '{"first": 0, "count": 0}', "[]", "[" * 100_000])
def test_a_damaged_count_of_parts_is_told(tmp_path, recipe, text):
    made, store = recipe(), tmp_path / "missions.zarr"
    generate_part(made, store, StorePart(0, 4))
    Job(made, store).files.write(ARRAY, text.encode())
    with pytest.raises(StoreError, match=r"array\.json is damaged .*: remove it"):
        generate_part(made, store, StorePart(1, 4))


def test_a_damaged_marker_is_none(tmp_path, recipe):
    job = Job(recipe(), tmp_path / "missions.zarr")
    drawn = Parameters(duration_s=1.5, values={"a.b": 0.1, "c": "word"}, segments=({"d": 1e-9},))
    failed = FailedAttempt(0, 0, "why", None)
    flown = FlownMission(0, 1, 4, drawn, {"start_latitude": 36.8}, {"bias": -0.3}, (failed,))
    sums = {"true_depth/c/0/0": FileSum(3, "ab")}
    marker = Marker(0, job.digest, sums, [flown], {"numpy": "2"})
    whole = marker.to_bytes()
    job.files.write(job.marker(0), whole)
    assert read_marker(job, 0) == marker
    flipped = [whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :] for at in range(len(whole))]
    for data in (b"", b"PK", whole[:-1], whole + b"x", *flipped):
        job.files.write(job.marker(0), data)
        assert read_marker(job, 0) is None
    for table in (b"[]", b"{}", b"[" * 100_000, b'{"files": 1}', b""):
        job.files.write(job.marker(0), hashlib.sha256(table).digest() + table)
        assert read_marker(job, 0) is None


@pytest.mark.parametrize("error", [FloorError("the floor is too near"), NoSteadyState("it spins")])
def test_what_cannot_be_flown_is_replaced(recipe, monkeypatch, error):
    real, tried = factory.sampling.fly.build_scenario, []

    def build(*words):
        tried.append(words)
        if len(tried) == 1:
            raise error
        return real(*words)

    monkeypatch.setattr(factory.sampling.fly, "build_scenario", build)
    ((flown, _),) = fly_missions(recipe(), [0])
    assert flown.attempt == 1
    assert flown.failures[0].reason == str(error)


@pytest.mark.parametrize("command", ["verify", "finish"])
@pytest.mark.parametrize("place", [".", "..", "/"])
def test_a_folder_without_its_name_is_answered(capsys, tmp_path, monkeypatch, command, place):
    (tmp_path / "within").mkdir()
    monkeypatch.chdir(tmp_path / "within")
    assert PROGRAM.main([command, place]) == 2
    message = capsys.readouterr().err
    assert f"error: {place} " in message
    assert "bug" not in message
