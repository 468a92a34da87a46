"""Shards through zarr: the same bytes by either codec pipeline, missing rows and edges included."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import zarr

from twin.records.schema import variable
from twin.records.storage import sharded
from twin.records.storage.checksums import ZARR_LIST, damaged_files, read_checksums
from twin.records.storage.sharded import DTYPE, ArrayMeta, ShardedStore
from twin.records.storage.stored_files import LocalFiles
from twin.records.store import open_store

MISSIONS, SAMPLES = 70, 300
"""More than one shard, the last one not full."""


def blocks() -> np.ndarray:
    values = np.cumsum(np.random.default_rng(0).standard_normal((MISSIONS, SAMPLES)), axis=1)
    values[3] = np.nan  # a signal that a mission lacks
    values[69] = np.nan
    values[5, 200:] = np.nan
    values[8] = 0.0
    return values.astype(np.float32)


def write(path: Path) -> dict[str, bytes]:
    store = ShardedStore(
        LocalFiles(path),
        missions=MISSIONS,
        samples=SAMPLES,
        shard_missions=64,
        row_missions=64,
        staging=path.with_suffix(".staging"),
    )
    values = blocks()
    signals = {"true_depth": values, "true_pitch": np.nan_to_num(values)}
    sums = {}
    for number, rows in enumerate((slice(0, 64), slice(64, 70))):
        for name, block in signals.items():
            key, found = store.write_shard(number, name, block[rows])
            sums[key] = found
    lengths = np.full(MISSIONS, SAMPLES, np.int32)
    numbers = {
        "mission": (np.arange(MISSIONS), "mission", {"long_name": "mission index"}),
        "time": (0.5 * np.arange(SAMPLES), "time", {"units": "s"}),
        "n_samples": (lengths, "mission", {"units": "1"}),
        "attempt": (np.zeros(MISSIONS, np.int8), "mission", {}),
        "word": (np.array(["a", "é"] * 35, np.dtypes.StringDType()), "mission", {}),
    }
    metadata = {}
    for name, (array, dimension, attributes) in numbers.items():
        step = 64 if dimension == "mission" else len(array)
        for number, first in enumerate(range(0, len(array), step)):
            part = array[first : first + step]
            key, found = store.write_rows(name, number, part, len(array), (dimension,))
            sums[key] = found
        metadata[name] = ArrayMeta(array.shape, array.dtype, (dimension,), attributes)
    declared = {name: (DTYPE, variable(name).stored_attributes()) for name in signals}
    sums |= store.finish(declared, metadata, {"seed": 1}, sums)
    store.close()
    files = {
        str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()
    }
    assert set(files) == {*sums, ZARR_LIST}
    assert {key: one.bytes for key, one in sums.items()} == {k: len(files[k]) for k in sums}
    assert read_checksums(path) == sums
    assert not list(damaged_files(path))
    return files


def test_both_pipelines_write_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("zarrs")
    fast = write(tmp_path / "fast.zarr")
    monkeypatch.setattr(sharded, "fast_pipeline", lambda: sharded.PYTHON_PIPELINE)
    assert write(tmp_path / "plain.zarr") == fast
    assert {"true_depth/c/0/0", "true_depth/c/1/0", "attempt/c/0", "zarr.json"} < set(fast)


def test_what_was_written_is_read(tmp_path: Path) -> None:
    write(tmp_path / "a.zarr")
    data = open_store(tmp_path / "a.zarr")
    np.testing.assert_array_equal(data["true_depth"], blocks())
    np.testing.assert_array_equal(data["attempt"], np.zeros(MISSIONS))
    assert data["true_depth"].attrs["units"] == "m"
    assert data.attrs["seed"] == 1
    assert list(data["word"].values[:3]) == ["a", "é", "a"]


def test_zarr_is_left_as_it_was_found(tmp_path: Path) -> None:
    before = dict(zarr.config.get("codec_pipeline"))
    workers = zarr.config.get("threading.max_workers")
    write(tmp_path / "a.zarr")
    assert dict(zarr.config.get("codec_pipeline")) == before
    assert zarr.config.get("threading.max_workers") == workers
