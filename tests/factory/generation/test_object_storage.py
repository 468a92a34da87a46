"""A store in an object storage has the bytes of one in a folder, and is read as one."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from clusters import dask_cluster
from s3 import s3_server

from factory.__main__ import main
from factory.generation.executors import dask_executor
from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.generation.job import unfinished
from factory.generation.parts import StorePart, finish, generate_part
from factory.store_check import check_files
from learn.data.dataset import load_missions
from twin.errors import InputError, StoreError, WriteError
from twin.records.storage.checksums import content_hash, store_hash
from twin.records.storage.object_storage import ObjectFiles
from twin.records.storage.store_path import Url, files_at, store_path
from twin.records.storage.whole import check_folder_target
from twin.records.store import open_store
from twin.records.windows import Windows


@pytest.fixture(scope="module")
def server():
    with pytest.MonkeyPatch.context() as patch, s3_server() as environment:
        for name, text in environment.items():
            patch.setenv(name, text)
        yield


@pytest.fixture(scope="module")
def stored(server, recipe):
    generate(recipe(), "s3://bucket/made/missions.zarr", workers=2)
    return "s3://bucket/made/missions.zarr"


def contents(place):
    files = files_at(place)
    return {key: files.read(key) for key in files.all_keys()}


def test_every_object_is_the_file_of_a_folder(stored, paper_store):
    assert contents(stored) == contents(paper_store)
    assert not contents(stored + ".generating")
    (line,) = contents(stored + ".log").values()
    assert b'"recipe"' in line


def test_windows_are_read_from_there(stored, paper_store):
    there, here = (
        Windows(place, ["measured_pitch", "true_surge"], length=20, memory=6e3)
        for place in (stored, paper_store)
    )
    assert not there.fits
    for a, b in zip(there.batches(64, seed=1), here.batches(64, seed=1), strict=True):
        np.testing.assert_array_equal(a, b)


def test_parts_and_finish_make_the_same_objects(server, recipe, paper_store):
    made, store = recipe(), "s3://bucket/parts/missions.zarr"
    generate_part(made, store, StorePart(1, 2))
    assert 0 < unfinished(store_path(store)).missions_kept < len(made.plan)
    with pytest.raises(StoreError, match=r"run these parts of 2 again: --array=0"):
        finish(store)
    with pytest.raises(StoreError, match=r"is incomplete: the `factory generate` command"):
        open_store(store)
    generate_part(made, store, StorePart(0, 2))
    summary, _ = finish(store)
    assert summary.missions == len(made.plan)
    assert contents(store) == contents(paper_store)


def test_the_metadata_of_the_store_come_last_and_a_kill_before_loses_nothing(
    server, recipe, paper_store, monkeypatch
):
    store, write = "s3://bucket/killed/missions.zarr", ObjectFiles.write

    def killed(files, key, data, *, safe=False):
        if key == "zarr.json":
            raise KeyboardInterrupt
        write(files, key, data, safe=safe)

    monkeypatch.setattr(ObjectFiles, "write", killed)
    with pytest.raises(KeyboardInterrupt):
        generate(recipe(), store, workers=1)
    assert set(contents(paper_store)) - set(contents(store)) == {"zarr.json"}
    monkeypatch.undo()
    with pytest.raises(StoreError, match="is incomplete: --resume completes it"):
        generate(recipe(), store, workers=1)
    with pytest.raises(StoreError, match=r"started with other settings \(.*seed"):
        generate(recipe(seed=5), store, workers=1, resume=True)
    assert generate(recipe(), store, workers=1, resume=True).flown == 0
    assert contents(store) == contents(paper_store)


def test_workers_of_a_dask_cluster_write_there(server, recipe, paper_store):
    pytest.importorskip("distributed", reason='needs pip install "glider-twin[cluster]"')
    store = "s3://bucket/cluster/missions.zarr"
    with dask_cluster(2) as address, dask_executor(address) as executor:
        summary = generate(recipe(), store, executor=executor)
    assert summary.flown == summary.missions
    assert contents(store) == contents(paper_store)


def test_nothing_is_replaced(stored, recipe):
    with pytest.raises(StoreError, match="already exists"):
        generate(recipe(), stored)
    with pytest.raises(StoreError, match=r"cannot replace .*choose another --out, or remove"):
        generate(recipe(), stored, overwrite=True)
    with pytest.raises(StoreError, match="exists and is not a store"):
        generate(recipe(), "s3://bucket/made")
    assert generate(recipe(), stored, resume=True).flown == 0


def test_it_is_read_as_a_folder_is(stored, paper_store):
    here, there = GeneratedStore(paper_store), GeneratedStore(stored)
    assert there.path == Url(stored)
    assert repr(there.parameters(1)) == repr(here.parameters(1))  # with NaN
    np.testing.assert_array_equal(there.row("true_depth", 1), here.row("true_depth", 1))
    assert not there.gone_arrays()
    assert store_hash(stored) == store_hash(paper_store)
    names = ("measured_depth", "true_surge")
    assert content_hash(stored, names) == content_hash(paper_store, names)
    for one, other in zip(
        load_missions(stored, names), load_missions(paper_store, names), strict=True
    ):
        np.testing.assert_array_equal(one.signals["true_surge"], other.signals["true_surge"])


def test_damage_is_found(server, paper_store):
    files = files_at("s3://bucket/damaged/missions.zarr")
    for key, data in contents(paper_store).items():
        files.write(key, data)
    assert not check_files(store_path(files.name)).problems
    data = bytearray(files.read("true_depth/c/0/0"))
    data[100] ^= 1
    files.write("true_depth/c/0/0", bytes(data))
    files.remove("time/c/0")
    files.write("left", b"")
    assert check_files(store_path(files.name)).problems == [
        "time/c/0 is missing",
        "true_depth/c/0/0 is changed: its SHA-256 is another one",
        "left is unknown",
    ]


def test_commands_keep_the_address(stored, capsys, tmp_path):
    for words in (["info", stored], ["verify", stored]):
        assert main_with(words) == 0
        assert "s3://bucket/made/missions.zarr" in capsys.readouterr().out
    assert main_with(["export", stored, "--to", "og1", "--out", str(tmp_path / "og1")]) == 0
    assert len(list((tmp_path / "og1").glob("*.nc"))) == len(GeneratedStore(stored))


def test_what_cannot_be_written_there_is_refused(stored, paper_store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for out in ("s3://bucket/og1", Path("s3://bucket/og1")):
        with pytest.raises(
            WriteError, match=r"s3://bucket/og1 is in an object storage, where only"
        ):
            check_folder_target(out)
    assert main_with(["export", str(paper_store), "--to", "og1", "--out", "s3://bucket/og1"]) == 2
    assert main_with(["plot", stored, "--out", "s3://bucket/page.png"]) == 2
    assert not list(tmp_path.iterdir())
    assert main_with(["plot", stored]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["missions.png"]


def main_with(words):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["factory", *words])
        return main()


def test_what_cannot_be_reached_is_told(server, recipe):
    with pytest.raises(StoreError, match=r"no store at s3://bucket/none\.zarr"):
        open_store("s3://bucket/none.zarr")
    with pytest.raises(StoreError, match=r"^cannot write s3://absent: the storage has no bucket"):
        generate(recipe(), "s3://absent/none.zarr", workers=1)
    with pytest.raises(InputError, match=r"unknown kind of address 's4': did you mean 's3'"):
        open_store("s4://bucket/none.zarr")
    with pytest.raises(InputError, match=r"s3://bucket names no store"):
        open_store("s3://bucket")


def test_addresses_have_the_names_of_paths():
    url = store_path("s3://bucket/folder/missions.zarr")
    assert str(url) == "s3://bucket/folder/missions.zarr"
    assert str(url.with_name("b.zarr") / "c") == "s3://bucket/folder/b.zarr/c"
    assert url == store_path(Path("s3://bucket/folder/missions.zarr"))
    assert pickle.loads(pickle.dumps(url)) == url
    with pytest.raises(TypeError, match="not a path of this machine"):
        open(url)  # noqa: PTH123, SIM115
