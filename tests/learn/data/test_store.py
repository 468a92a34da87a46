"""Stores that must not be trained on: each is refused with a line that names what is wrong."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from learn_missions import write_dataset, write_synthetic_store

from learn.data.dataset import load_missions
from twin.errors import StoreError
from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.reader import MissionStore
from twin.records.schema import VARIABLES
from twin.records.schema.limits import recorded_limits
from twin.records.storage.checksums import content_hash

CHANNELS = ("measured_pitch", "measured_depth", "true_surge")


@pytest.fixture
def store(tmp_path):
    return write_synthetic_store(tmp_path / "s.zarr", [50, 60], [0, 1])


def edit_metadata(path, change):
    metadata = json.loads(path.read_text())
    change(metadata)
    path.write_text(json.dumps(metadata))


def test_a_store_without_time_is_not_read_as_if_it_had_a_sample_every_second(store):
    shutil.rmtree(store / "time")
    with pytest.raises(StoreError, match="array time is gone"):
        load_missions(store, CHANNELS)

    def forget(root):
        del root["consolidated_metadata"]["metadata"]["time"]

    edit_metadata(store / "zarr.json", forget)
    with pytest.raises(StoreError, match=r"s\.zarr has no coordinate 'time'"):
        load_missions(store, CHANNELS)


@pytest.mark.parametrize("schema", [None, "somebody else's missions"])
def test_a_store_of_another_schema_is_refused(store, schema):
    def rename(root):
        if schema is None:
            del root["attributes"]["schema"]
        else:
            root["attributes"]["schema"] = schema

    edit_metadata(store / "zarr.json", rename)
    with pytest.raises(StoreError) as caught:
        load_missions(store, CHANNELS)
    assert "attribute schema" in str(caught.value)
    assert SIMULATED_ATTRIBUTES["schema"] in str(caught.value)
    assert schema is None or schema in str(caught.value)


@pytest.mark.parametrize("samples", [0, 1, -3, 61])
def test_impossible_numbers_of_samples_are_named(store, samples):
    dataset = xr.open_zarr(store).load()
    dataset["n_samples"][1] = samples
    for variable in dataset.variables.values():
        variable.encoding.clear()
    write_dataset(dataset, store)
    with pytest.raises(StoreError, match=rf"n_samples of mission 1 is {samples}; .* 2 to 60"):
        load_missions(store, CHANNELS)
    assert load_missions(store, CHANNELS, split="train")[0].samples == 50


def chunks(store, name):
    return [p for p in (store / name).rglob("*") if p.is_file() and p.name != "zarr.json"]


def test_damaged_and_missing_files_name_store_and_channel(store):
    (chunk,) = chunks(store, "measured_depth")
    chunk.write_bytes(chunk.read_bytes()[:-9])
    with pytest.raises(StoreError, match=r"s\.zarr is damaged: its array measured_depth"):
        load_missions(store, CHANNELS)
    shutil.rmtree(store / "measured_depth")
    with pytest.raises(StoreError, match="array measured_depth is gone"):
        load_missions(store, CHANNELS)


def test_an_absurd_value_is_refused_with_its_place_and_the_way_out(tmp_path):
    def poke(arrays):
        arrays["measured_pump"][1, 7] = 1e30

    store = write_synthetic_store(tmp_path / "a.zarr", [50, 60], [0, 1], edit=poke)
    with pytest.raises(StoreError) as caught:
        load_missions(store, ("measured_pump",))
    for part in ("measured_pump of mission 1", "sample 7 (3.5 s)", "50000 cm3", "--without pump"):
        assert part in str(caught.value)
    assert len(load_missions(store, ("measured_pump",), split="train")) == 1


def test_every_variable_has_limits_and_a_missing_value_is_within_them(store):
    reader = MissionStore(store)
    for name in VARIABLES:
        low, high = recorded_limits(name)
        assert low < high
        reader.check_possible(name, np.array([low, high, np.nan]), mission=0)
        with pytest.raises(StoreError, match=f"{name} of mission 0"):
            reader.check_possible(name, np.array([high * 1.01]), mission=0)


def test_the_content_is_that_of_the_arrays_and_not_of_the_attributes(store, tmp_path):
    copy = Path(shutil.copytree(store, tmp_path / "copy.zarr"))
    before = content_hash(store, CHANNELS)

    def rename(root):
        root["attributes"]["history"] = "made again"

    edit_metadata(copy / "zarr.json", rename)
    shutil.rmtree(copy / "measured_roll")
    assert content_hash(copy, CHANNELS) == before
    MissionStore(copy).close()
    (chunk,) = chunks(copy, "true_surge")
    chunk.write_bytes(chunk.read_bytes()[:-1])
    assert content_hash(copy, CHANNELS) != before
