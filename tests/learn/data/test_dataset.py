"""Dataset: reading, split, windows, and what is said when a store cannot be used."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from learn_missions import synthetic_mission, write_dataset, write_synthetic_store

from learn.data.dataset import load_missions
from learn.data.preparation import SampleDivision, prepare
from learn.data.sequences import NormalisationFit, Sequences, batches, cut_windows, pack_windows
from twin.errors import InputError, StoreError
from twin.navigation.features import channels_of, select_features
from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.reader import MissionStore
from twin.records.schema import VARIABLES
from twin.records.schema.limits import recorded_limits
from twin.records.storage.checksums import content_hash

CHANNELS = (*channels_of(select_features()), "true_surge")


def test_missions_come_back_as_written(small_store):
    missions = load_missions(small_store, CHANNELS)
    assert [m.samples for m in missions] == [1200, 900, 1500, 1100, 1300, 1000, 1400, 1250]
    assert missions[3].period == 0.5
    expected = synthetic_mission(1100, 3)["measured_pitch"].astype(np.float32)
    assert np.array_equal(missions[3].signals["measured_pitch"], expected)


def test_splits_are_disjoint_and_complete(small_store):
    parts = {
        part: [m.index for m in load_missions(small_store, CHANNELS, split=part)]
        for part in ("train", "validation", "test")
    }
    assert parts == {"train": [0, 1, 3, 5, 7], "validation": [2, 6], "test": [4]}


def test_words_and_numbers_name_the_same_split(tmp_path, small_store):
    words = xr.open_zarr(small_store)[["measured_pitch", "n_samples"]].load()
    words["split"] = ("mission", np.array(["train", "test"] * 4))
    path = tmp_path / "words.zarr"
    words.encoding = {}
    for name in words.variables:
        words[name].encoding = {}
    write_dataset(words, path)
    found = load_missions(path, ["measured_pitch"], split="test")
    assert [m.index for m in found] == [1, 3, 5, 7]


def test_preparation_fits_scales_on_training_missions_only(small_store, tmp_path):
    features = select_features()
    data = prepare(small_store, target="surge", features=features, mirror=False)
    assert len(data.train.inputs) == 5
    assert len(data.validation.inputs) == 2
    stacked = np.concatenate(data.train.inputs)
    assert np.allclose(stacked.mean(0), 0.0, atol=1e-3)
    assert np.concatenate(data.train.targets).std() == pytest.approx(1.0, abs=1e-3)

    def louder(arrays):  # another vehicle in the missions that are not for training
        arrays["measured_pitch"][[2, 4, 6]] *= 2.0

    lengths = [1200, 900, 1500, 1100, 1300, 1000, 1400, 1250]
    other = write_synthetic_store(
        tmp_path / "other.zarr", lengths, [0, 0, 1, 0, 2, 0, 1, 0], edit=louder
    )
    again = prepare(other, target="surge", features=features, mirror=False)
    assert again.normalisation == data.normalisation


def test_the_papers_division_counts_every_sample_once(small_store):
    data = prepare(small_store, target="sway", features=("sin_roll",), division="samples")
    assert len(data.train.inputs) == len(data.validation.inputs) == 8
    train, validation = (np.concatenate(part.weights) for part in (data.train, data.validation))
    assert not (train * validation).any()
    assert train.mean() == pytest.approx(0.7, abs=0.02)
    assert validation.mean() == pytest.approx(0.15, abs=0.02)
    division = SampleDivision(np.array([5, 70, 300]), 1)
    total = sum(division.weights(2, part) for part in ("train", "validation", "test"))
    assert (total == 1.0).all()
    drawn = np.random.default_rng(1).random(375)[75:]
    assert np.array_equal(division.weights(2, "train"), drawn < 0.7)


@given(
    lengths=st.lists(st.integers(1, 400), min_size=1, max_size=6),
    length=st.integers(1, 150),
    washin=st.integers(0, 80),
    seed=st.none() | st.integers(0, 1000),
)
def test_windows_count_every_sample_exactly_once(lengths, length, washin, seed):
    rng = None if seed is None else np.random.default_rng(seed)
    windows = cut_windows(lengths, length=length, washin=washin, rng=rng)
    counted = [np.zeros(n, int) for n in lengths]
    for mission, start, skip, count, mirrored in windows.table:
        assert not mirrored
        assert start >= 0
        assert skip == min(washin, start + skip)
        counted[mission][start + skip : start + skip + count] += 1
    for column in counted:
        assert (column == 1).all()


@given(size=st.integers(1, 20), seed=st.integers(0, 100))
def test_batches_hold_every_window_once(size, seed):
    windows = cut_windows([300, 77, 512], length=40, washin=9, rng=np.random.default_rng(seed))
    groups = batches(windows, size, np.random.default_rng(seed))
    assert sorted(map(tuple, np.concatenate(groups))) == sorted(map(tuple, windows.table))
    assert max(len(group) for group in groups) <= size


def test_packed_windows_are_the_missions_own_samples():
    inputs = [np.arange(n * 2, dtype=np.float32).reshape(n, 2) + 1000 * n for n in (10, 25)]
    targets = [values[:, 0] for values in inputs]
    sequences = Sequences(inputs, targets, [np.ones(len(t), np.float32) for t in targets])
    windows = cut_windows(sequences.lengths, length=8, washin=3)
    x, y, w = pack_windows(sequences, windows.table)
    assert x.shape == (11, len(windows), 2)
    assert w.sum() == 35
    for column, (mission, start, skip, count, _) in enumerate(windows.table):
        span = skip + count
        assert np.array_equal(x[:span, column], inputs[mission][start : start + span])
        assert not w[:skip, column].any()
        assert w[skip:span, column].all()
        assert not w[span:, column].any()
        assert np.array_equal(y[skip:span, column], targets[mission][start + skip : start + span])


def test_mirrored_windows_are_the_mirror_image(small_store):
    features = ("sin_roll", "cos_roll", "yaw_rate", "depth_rate")
    data = prepare(small_store, target="sway", features=features).train
    windows = cut_windows(data.lengths, length=200, washin=20, mirror=True).table
    seen, image = np.split(windows, 2)
    x, y, w = pack_windows(data, seen)
    x_image, y_image, w_image = pack_windows(data, image)
    assert np.array_equal(x_image, x * np.array([-1.0, 1.0, -1.0, 1.0], np.float32))
    assert np.array_equal(y_image, -y)
    assert np.array_equal(w_image, w)
    drawn = cut_windows(
        data.lengths, length=20, washin=20, rng=np.random.default_rng(0), mirror=True
    )
    assert 0.3 < drawn.table[:, 4].mean() < 0.7
    plain = prepare(small_store, target="sway", features=features, mirror=False).train
    assert np.array_equal(pack_windows(plain, image)[1], pack_windows(plain, seen)[1])


def test_a_missing_store_says_how_to_make_one(tmp_path):
    with pytest.raises(StoreError, match="factory generate"):
        load_missions(tmp_path / "none.zarr", CHANNELS)


def test_an_empty_store_is_named(tmp_path):
    path = write_synthetic_store(tmp_path / "empty.zarr", [], [])
    with pytest.raises(StoreError, match=r"empty\.zarr holds no missions"):
        load_missions(path, CHANNELS)


def test_a_store_without_a_split_is_refused_where_one_is_needed(tmp_path):
    path = write_synthetic_store(tmp_path / "unsplit.zarr", [50, 60])
    assert len(load_missions(path, CHANNELS, split="all")) == 2
    with pytest.raises(StoreError, match="no array 'split'"):
        load_missions(path, CHANNELS, split="test")
    with pytest.raises(StoreError, match="no missions for training"):
        prepare(path, target="surge", features=("sin_roll",))


def test_a_part_without_missions_says_what_there_is(tmp_path):
    path = write_synthetic_store(tmp_path / "part.zarr", [50, 60], [0, 0])
    with pytest.raises(StoreError, match=r"'test' \(train 2, validation 0, test 0\)"):
        load_missions(path, CHANNELS, split="test")
    with pytest.raises(StoreError, match="unknown split 'tset': did you mean 'test'"):
        load_missions(path, CHANNELS, split="tset")


def test_missing_channels_are_named(tmp_path):
    drop = ("measured_yaw_rate", "measured_pump")
    path = write_synthetic_store(tmp_path / "less.zarr", [50, 60], [0, 1], drop=drop)
    with pytest.raises(StoreError, match=r"no channel measured_yaw_rate \(nor measured_pump\)"):
        load_missions(path, CHANNELS)
    features = select_features(without=["imu", "controls"])
    assert len(prepare(path, target="surge", features=features).train.inputs) == 1


def test_nan_in_a_channel_or_target_names_the_mission(tmp_path):
    def poke(arrays):
        arrays["measured_depth"][1, 12] = np.nan
        arrays["true_sway"][0, 3] = np.nan

    path = write_synthetic_store(tmp_path / "nan.zarr", [50, 60], [0, 1], edit=poke)
    with pytest.raises(StoreError, match="measured_depth of mission 1 is not finite"):
        prepare(path, target="surge", features=select_features())
    with pytest.raises(StoreError, match="true_sway of mission 0 is not finite at 1 samples"):
        prepare(path, target="sway", features=("sin_roll",))


def test_unknown_targets_and_divisions_are_refused(small_store):
    with pytest.raises(InputError, match="unknown target 'heave'"):
        prepare(small_store, target="heave", features=("sin_roll",))
    with pytest.raises(InputError, match="unknown division 'sample': did you mean 'samples'"):
        prepare(small_store, target="surge", features=("sin_roll",), division="sample")


# --- Stores that must not be trained on: each is refused with a line that names what is wrong


STORE_CHANNELS = ("measured_pitch", "measured_depth", "true_surge")


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
        load_missions(store, STORE_CHANNELS)

    def forget(root):
        del root["consolidated_metadata"]["metadata"]["time"]

    edit_metadata(store / "zarr.json", forget)
    with pytest.raises(StoreError, match=r"s\.zarr has no coordinate 'time'"):
        load_missions(store, STORE_CHANNELS)


@pytest.mark.parametrize("schema", [None, "somebody else's missions"])
def test_a_store_of_another_schema_is_refused(store, schema):
    def rename(root):
        if schema is None:
            del root["attributes"]["schema"]
        else:
            root["attributes"]["schema"] = schema

    edit_metadata(store / "zarr.json", rename)
    with pytest.raises(StoreError) as caught:
        load_missions(store, STORE_CHANNELS)
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
        load_missions(store, STORE_CHANNELS)
    assert load_missions(store, STORE_CHANNELS, split="train")[0].samples == 50


def chunks(store, name):
    return [p for p in (store / name).rglob("*") if p.is_file() and p.name != "zarr.json"]


def test_damaged_and_missing_files_name_store_and_channel(store):
    (chunk,) = chunks(store, "measured_depth")
    chunk.write_bytes(chunk.read_bytes()[:-9])
    with pytest.raises(StoreError, match=r"s\.zarr is damaged: its array measured_depth"):
        load_missions(store, STORE_CHANNELS)
    shutil.rmtree(store / "measured_depth")
    with pytest.raises(StoreError, match="array measured_depth is gone"):
        load_missions(store, STORE_CHANNELS)


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
    before = content_hash(store, STORE_CHANNELS)

    def rename(root):
        root["attributes"]["history"] = "made again"

    edit_metadata(copy / "zarr.json", rename)
    shutil.rmtree(copy / "measured_roll")
    assert content_hash(copy, STORE_CHANNELS) == before
    MissionStore(copy).close()
    (chunk,) = chunks(copy, "true_surge")
    chunk.write_bytes(chunk.read_bytes()[:-1])
    assert content_hash(copy, STORE_CHANNELS) != before


# --- Normalisation: scales of what networks see


def test_normalisation_gives_unit_inputs_and_leaves_constants_alone():
    rng = np.random.default_rng(0)
    matrices = [rng.normal(3.0, 2.0, (500, 2)).astype(np.float32) for _ in range(3)]
    matrices = [np.concatenate([m, np.full((500, 1), 7.0, np.float32)], 1) for m in matrices]
    targets = [rng.normal(0.3, 0.1, 500).astype(np.float32) for _ in range(3)]
    fitted = NormalisationFit(("a", "b", "c"), "surge")
    for matrix, wanted in zip(matrices, targets, strict=True):
        fitted.add(matrix, wanted)
    found = fitted.result()
    values = found.inputs(np.concatenate(matrices))
    assert np.allclose(values.mean(0), 0.0, atol=1e-4)
    assert np.allclose(values.std(0), [1.0, 1.0, 0.0], atol=1e-4)
    assert found.scale[2] == 1.0
    everything = np.concatenate(targets).astype(float)
    assert found.target_mean == pytest.approx(everything.mean(), rel=1e-13)
    assert found.target_scale == pytest.approx(everything.std(), rel=1e-13)
    deviations = np.concatenate(matrices).astype(float).std(0)
    assert found.scale[:2] == pytest.approx(deviations[:2], rel=1e-13)
