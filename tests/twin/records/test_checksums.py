"""Checksums find every change of a folder; shards have the bytes that zarr writes."""

import json
import random
import tracemalloc
import warnings

import numpy as np
import pytest
import xarray as xr
import zarr
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec

from twin.errors import StoreError
from twin.records.schema import variable
from twin.records.storage.checksums import (
    LIST,
    ZARR_LIST,
    FileSum,
    damaged_files,
    file_sum,
    has_checksums,
    read_checksums,
    write_checksums,
)
from twin.records.storage.sharded import (
    DTYPE,
    ArrayMeta,
    ShardedStore,
    ShardWriter,
    fast_pipeline,
    fill_value,
)
from twin.records.storage.store_path import Files
from twin.records.store import open_store, read_zarr, write_zarr


def said(folder, only=None):
    return [(one.path, one.what) for one in damaged_files(folder, only)]


@pytest.fixture
def plain(tmp_path):
    folder = tmp_path / "plain"
    (folder / "a").mkdir(parents=True)
    (folder / "a" / "one.bin").write_bytes(bytes(range(256)))
    (folder / "two.txt").write_text("two")
    (folder / "empty").touch()
    write_checksums(folder)
    return folder


@pytest.fixture
def store(tmp_path):
    path = tmp_path / "store.zarr"
    rows = (("mission", "time"), np.arange(12.0).reshape(2, 6))
    write_zarr(xr.Dataset({"depth": rows}, attrs={"title": "test"}), path)
    write_checksums(path)
    return path


def test_a_sound_folder_has_no_damage(plain):
    assert has_checksums(plain)
    assert said(plain) == []
    assert sorted(read_checksums(plain)) == ["a/one.bin", "empty", "two.txt"]
    assert read_checksums(plain)["two.txt"] == FileSum(
        3, "3fc4ccfe745870e2c0d99f71f30ff0656c8dedd41cc1d7d3d376b0dbe685e2f3"
    )


def test_changed_missing_unknown_and_cut_files_are_told_apart(plain):
    (plain / "a" / "one.bin").write_bytes(bytes(255) + b"x")
    (plain / "two.txt").unlink()
    (plain / "new").touch()
    assert said(plain) == [("a/one.bin", "changed"), ("two.txt", "missing"), ("new", "unknown")]
    (plain / "a" / "one.bin").write_bytes(b"")
    assert str(next(damaged_files(plain))) == "a/one.bin is changed: 0 bytes instead of 256"


def test_only_some_files_are_read_when_some_are_named(plain):
    (plain / "a" / "one.bin").write_bytes(b"")
    (plain / "two.txt").write_text("six")
    assert said(plain, ["two.txt"]) == [("two.txt", "changed")]
    assert said(plain, ["a"]) == [("a/one.bin", "changed")]
    assert said(plain, ["empty", "tw"]) == []


@pytest.mark.parametrize("kind", ["plain", "store"])
def test_every_flipped_bit_of_the_list_itself_is_found(kind, request):
    folder = request.getfixturevalue(kind)
    path = folder / (LIST if kind == "plain" else ZARR_LIST)
    whole = path.read_bytes()
    for place in range(len(whole)):
        bit = 1 << random.Random(place).randrange(8)
        path.write_bytes(whole[:place] + bytes([whole[place] ^ bit]) + whole[place + 1 :])
        assert said(folder) == [(path.relative_to(folder).as_posix(), "changed")], place
    path.write_bytes(whole)
    assert said(folder) == []


def test_a_list_that_is_cut_or_replaced_is_damage(plain):
    path = plain / LIST
    whole = path.read_bytes()
    for text in (b"", b"[]", b"{}", whole[:-1], whole + b"\n", b"[" * 100_000, b'{"files": 3}'):
        path.write_bytes(text)
        assert said(plain) == [(LIST, "changed")]
    table = json.loads(whole)
    del table["files"]["two.txt"]  # with the digest of the whole list
    path.write_text(json.dumps(table, sort_keys=True, separators=(",", ":")))
    assert said(plain) == [(LIST, "changed")]


def test_a_folder_without_a_list_says_so(tmp_path):
    assert not has_checksums(tmp_path)
    with pytest.raises(StoreError, match="has no list of checksums"):
        list(damaged_files(tmp_path))


def test_sums_that_are_known_are_not_read_again(plain):
    given = FileSum(1, "0" * 64)
    write_checksums(plain, {"a/one.bin": given})
    assert read_checksums(plain)["a/one.bin"] == given
    assert read_checksums(plain)["two.txt"] == file_sum(plain / "two.txt")


@pytest.mark.parametrize("consolidated", [None, True, False])
def test_zarr_opens_a_store_with_a_list_without_a_warning(store, consolidated):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with xr.open_zarr(store, consolidated=consolidated) as dataset:
            assert list(dataset.data_vars) == ["depth"]
            assert dataset.attrs == {"title": "test"}
        group = zarr.open_group(store, mode="r", use_consolidated=consolidated)
        assert list(group.array_keys()) == ["depth"]
    assert has_checksums(store)
    assert not (store / LIST).exists()


def test_damage_of_a_store_is_found_in_arrays_metadata_and_attributes(store):
    for path in sorted(p for p in store.rglob("*") if p.is_file() and "checksums" not in str(p)):
        whole = path.read_bytes()
        path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
        assert said(store) == [(path.relative_to(store).as_posix(), "changed")]
        path.write_bytes(whole)
    (store / "zarr.json").unlink()
    assert said(store) == [("zarr.json", "missing")]


def test_a_large_file_is_read_in_pieces(tmp_path):
    with (tmp_path / "large").open("wb") as file:
        file.truncate(100_000_000)
    write_checksums(tmp_path)
    tracemalloc.start()
    assert said(tmp_path) == []
    assert tracemalloc.get_traced_memory()[1] < 2_000_000
    tracemalloc.stop()


def test_a_changed_chunk_of_any_store_fails_where_it_is_read(tmp_path):
    """Readers that know nothing of the list of checksums are warned too."""

    values = np.random.default_rng(0).normal(15.0, 2.0, (3, 400)).astype(np.float32)
    words = xr.DataArray(np.array(["a", "b", "c"], object), dims="mission")
    write_zarr(xr.Dataset({"t": (("mission", "time"), values), "w": words}), tmp_path / "a.zarr")
    chunk = next(path for path in (tmp_path / "a.zarr" / "t" / "c").rglob("*") if path.is_file())
    whole = chunk.read_bytes()
    for place in range(0, len(whole), 97):
        changed = bytearray(whole)
        changed[place] ^= 4
        chunk.write_bytes(bytes(changed))
        with pytest.raises(Exception, match=r"(?i)checksum|crc|zstd|decompress"):
            xr.open_zarr(tmp_path / "a.zarr")["t"].load()
    chunk.write_bytes(whole)
    assert list(xr.open_zarr(tmp_path / "a.zarr")["w"].values) == ["a", "b", "c"]


def test_a_group_grows_along_a_dimension_and_takes_other_arrays(tmp_path):
    path = tmp_path / "a.zarr"
    for first in (0, 2):
        values = np.arange(first, first + 2.0)
        write_zarr(xr.Dataset({"t": ("mission", values)}), path, along="mission" if first else None)
    write_zarr(xr.Dataset({"kind": ("deployment", [7.0])}), path, beside=True)
    found = read_zarr(path)
    assert found["t"].values.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert found["kind"].values.tolist() == [7.0]


# --- shards, byte for byte as zarr writes them ----------------------------------------------------


MISSIONS, SAMPLES, SHARD = 70, 20_000, 64
"""More than one shard, the last one not full; more than one block of Blosc in a chunk"""


def signal():
    values = np.cumsum(np.random.default_rng(0).standard_normal((MISSIONS, SAMPLES)), axis=1)
    values[[0, 3, 69]] = np.nan  # a signal that a mission lacks
    values[5, 200:] = np.nan
    values[8] = 0.0
    return values.astype(np.float32)


def write_shard(files, number, signals):
    """Missions one by one, without their padding, and without what they lack."""
    sums = {}
    folder = files.folder.with_suffix(f".{number}")
    with ShardWriter(folder, missions=SHARD, samples=SAMPLES) as writer:
        for mission in range(number * SHARD, min(MISSIONS, (number + 1) * SHARD)):
            rows = {name: values[mission] for name, values in signals.items()}
            writer.add(
                {
                    name: row[:200] if mission == 5 else row
                    for name, row in rows.items()
                    if not np.array_equal(
                        row, np.full_like(row, fill_value(row.dtype)), row.dtype.kind == "f"
                    )
                }
            )
        for name, found in writer.finish().items():
            files.take({f"{name}/c/{number}/0": folder / name})
            sums[f"{name}/c/{number}/0"] = found
    return sums


def write(path):
    files = Files(path)
    signals = {"true_pitch": np.nan_to_num(signal()), "true_depth": signal()}
    store = ShardedStore(
        files, missions=MISSIONS, samples=SAMPLES, shard_missions=SHARD, row_missions=SHARD
    )
    store.sums |= write_shard(files, 1, signals) | write_shard(files, 0, signals)
    lengths = np.full(MISSIONS, SAMPLES, np.int32)
    numbers = {
        "mission": (np.arange(MISSIONS), "mission", {"long_name": "mission index"}),
        "time": (0.5 * np.arange(SAMPLES), "time", {"units": "s"}),
        "n_samples": (lengths, "mission", {"units": "1"}),
        "attempt": (np.zeros(MISSIONS, np.int8), "mission", {}),
        "word": (np.array(["a", "é"] * 35, np.dtypes.StringDType()), "mission", {}),
    }
    for name, (array, dimension, attributes) in numbers.items():
        meta = ArrayMeta(array.shape, array.dtype, (dimension,), attributes)
        step = SHARD if dimension == "mission" else len(array)
        for number, first in enumerate(range(0, len(array), step)):
            store.write_rows(name, number, array[first : first + step], meta)
    declared = {name: (DTYPE, variable(name).stored_attributes()) for name in signals}
    store.finish(declared, {"seed": 1})
    sums = store.sums
    written = {
        str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()
    }
    assert set(written) == {*sums, ZARR_LIST}
    assert {key: one.bytes for key, one in sums.items()} == {k: len(written[k]) for k in sums}
    assert read_checksums(path) == sums
    assert not list(damaged_files(path))
    return written


@pytest.mark.parametrize("kind", ["<f4", "<f8", "<i8"])
def test_a_shard_has_the_bytes_that_zarr_writes(tmp_path, kind):
    dtype, values = np.dtype(kind), signal()
    padded = np.nan_to_num(100.0 * values).astype(dtype)
    padded[np.isnan(values)] = fill_value(dtype)
    memory: dict = {}
    blosc = BloscCodec(
        typesize=dtype.itemsize, cname="zstd", clevel=1, shuffle="shuffle", blocksize=0
    )
    with zarr.config.set({"threading.max_workers": 1}):
        zarr.create_array(
            memory,
            shape=padded.shape,
            shards=(SHARD, SAMPLES),
            chunks=(1, SAMPLES),
            dtype=dtype,
            fill_value=fill_value(dtype),
            serializer=BytesCodec(),
            compressors=[blosc, Crc32cCodec()],
            config={"write_empty_chunks": True},
        )[:] = padded
    files = Files(tmp_path / "a.zarr")
    for number in (0, 1):
        key = f"x/c/{number}/0"
        assert write_shard(files, number, {"x": padded})[key] == files.sum(key)
        assert files.read(key) == memory[f"c/{number}/0"].to_bytes()


def test_what_was_written_is_read(tmp_path):
    assert {"true_depth/c/1/0", "attempt/c/0", "zarr.json"} < set(write(tmp_path / "a.zarr"))
    data = open_store(tmp_path / "a.zarr")
    np.testing.assert_array_equal(data["true_depth"], signal())
    np.testing.assert_array_equal(data["attempt"], np.zeros(MISSIONS))
    assert data["true_depth"].attrs["units"] == "m"
    assert data.attrs["seed"] == 1
    assert list(data["word"].values[:3]) == ["a", "é", "a"]
    with zarr.config.set({"codec_pipeline.path": fast_pipeline()}):
        whole = zarr.open_array(tmp_path / "a.zarr" / "true_depth", mode="r")
        np.testing.assert_array_equal(whole[...], signal())


def test_zarr_is_left_as_it_was_found(tmp_path):
    before = dict(zarr.config.get("codec_pipeline"))
    write(tmp_path / "a.zarr")
    assert dict(zarr.config.get("codec_pipeline")) == before
