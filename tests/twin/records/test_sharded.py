"""Shards have the bytes that zarr writes, missing rows and edges included, and are read."""

import numpy as np
import pytest
import zarr
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec

from twin.records.schema import variable
from twin.records.storage.checksums import ZARR_LIST, damaged_files, read_checksums
from twin.records.storage.sharded import (
    DTYPE,
    ShardedStore,
    ShardWriter,
    fast_pipeline,
    fill_value,
)
from twin.records.storage.store_path import Files
from twin.records.store import open_store

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
        store.write_rows(name, (dimension,), array, attributes)
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
