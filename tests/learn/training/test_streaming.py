"""Streaming: training from the store gives what training from memory gives, in bounded memory."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
import torch
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from learn_missions import FLAGS, PERIOD, write_dataset, write_synthetic_store

from learn.data.preparation import prepare, training_lengths
from learn.data.sequences import ahead
from learn.networks.base import NetworkConfig, build_network
from learn.training.feed import SampleFeed, WindowFeed, feed_for
from learn.training.fit_config import FitConfig
from learn.training.optimiser import TrainingConfig
from learn.training.resources import choose_residence, free_memory
from learn.training.trainer import Trainer, mean_squared_error
from twin.errors import InputError, StoreError
from twin.navigation.features import INPUT_SETS, select_features
from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.reader import MissionStore
from twin.records.schema import SCHEMA_VERSION, VARIABLES
from twin.records.windows import buffers

FEATURES = select_features(("attitude", "depth_rate", "glide_speed"))
LENGTHS = [700, 400, 900, 300, 500, 800, 650, 450, 350, 600]
SPLITS = [0, 0, 1, 0, 0, 2, 0, 1, 0, 0]
BUFFER = 1000


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Seven missions for training, 3300 samples: four buffers."""
    return write_synthetic_store(tmp_path_factory.mktemp("s") / "s.zarr", LENGTHS, SPLITS)


def config_of(store, *, kind="elman", optimiser="soap", buffer=BUFFER, **changes):
    shape = {"hidden": 4, "layers": 1, "period": 0.5}
    training = TrainingConfig(
        optimiser=optimiser, seconds=0, epochs=2, validations=5, batch=4, window=64, washin=16,
        full_window=128, samples=64, buffer=buffer,
    )  # fmt: skip
    network = NetworkConfig(kind=kind, **shape)
    return FitConfig(
        store=str(store), features=FEATURES, network=network, training=training, **changes
    )


def trained(config, *, resident, target="sway", **options):
    with prepare(
        config.store,
        target=target,
        features=config.features,
        division=config.division,
        resident=resident,
    ) as data:
        scale = data.normalisation.target_scale
        made = Trainer(
            config.network,
            config.training,
            data.train,
            data.validation,
            target_scale=scale,
            **options,
        ).run()
    figures = [(r.step, r.epoch, r.train_mse, r.validation_mse) for r in made.history]
    return {k: v.numpy().tobytes() for k, v in made.network.state_dict().items()}, figures


@pytest.mark.parametrize(
    ("kind", "optimiser", "division"),
    [
        ("elman", "soap", "missions"),
        ("ema", "soap", "missions"),
        ("elman", "scg", "missions"),
        ("elman", "adam", "samples"),
    ],
)
def test_streamed_training_gives_the_same_bits(store, kind, optimiser, division):
    config = config_of(store, kind=kind, optimiser=optimiser, division=division)
    weights, figures = trained(config, resident=True)
    streamed, its_figures = trained(config, resident=False)
    assert streamed == weights
    assert its_figures == figures
    assert len(figures) >= 2
    whole, _ = trained(
        config_of(store, kind=kind, optimiser=optimiser, buffer=10**6), resident=True
    )
    assert whole != weights  # the buffer has a part in the order


class Killed(Exception):
    """Stands for a kill after a checkpoint."""


def test_a_streamed_training_goes_on_within_a_buffer(store, tmp_path):
    config = config_of(store)
    straight, _ = trained(config, resident=True)
    count = 0

    def kill(report):
        nonlocal count
        count += 1
        if count == 3:
            raise Killed

    place = tmp_path / "checkpoint"
    with pytest.raises(Killed):
        trained(config, resident=False, checkpoint=place, report=kill)
    assert place.exists()
    assert trained(config, resident=False, checkpoint=place)[0] == straight


def test_scales_and_sequences_are_equal_both_ways(store):
    options = {"target": "surge", "features": FEATURES}
    with prepare(store, **options) as kept, prepare(store, **options, resident=False) as streamed:
        assert kept.normalisation == streamed.normalisation
        places = np.array([4, 0, 2])
        one, other = kept.train.take(places), streamed.train.take(places)
        for name in ("inputs", "targets", "weights"):
            for a, b in zip(getattr(one, name), getattr(other, name), strict=True):
                assert np.array_equal(a, b)
        assert list(streamed.train.lengths) == [700, 400, 300, 500, 650, 350, 600]
        assert list(streamed.validation.lengths) == [900, 450]
        assert [len(part.inputs) for part in ahead(streamed.train, [places, places[:1]])] == [3, 1]


def test_a_store_that_goes_away_under_a_training_is_an_error(tmp_path):
    path = write_synthetic_store(tmp_path / "s.zarr", LENGTHS, SPLITS)
    with prepare(path, target="surge", features=FEATURES, resident=False) as data:
        (chunk,) = list((path / "measured_depth").rglob("c"))
        shutil.rmtree(chunk)
        with pytest.raises(StoreError, match="measured_depth"):
            data.train.take([0, 1])


@given(
    lengths=st.lists(st.integers(1, 400), min_size=1, max_size=60),
    size=st.integers(1, 3000),
    seed=st.none() | st.integers(0, 99),
)
def test_every_mission_is_in_one_buffer_of_about_the_size(lengths, size, seed):
    lengths = np.array(lengths)
    rng = None if seed is None else np.random.default_rng(seed)
    plan = buffers(lengths, size, rng)
    assert sorted(np.concatenate(plan)) == list(range(len(lengths)))
    for places in plan:
        assert len(places)
        assert list(places) == sorted(places)
        assert lengths[places].sum() <= 2 * size + 2 * lengths.max()
    if lengths.sum() <= size:
        assert len(plan) == 1


def test_buffers_of_an_epoch_mix_neighbours_that_another_epoch_parts():
    lengths = np.full(400, 100)
    first, second = (buffers(lengths, 10_000, np.random.default_rng(k)) for k in range(2))
    assert len(first) == 4
    assert all(90 <= len(part) <= 110 for part in first)
    assert any(set(a) != set(b) for a, b in zip(first, second, strict=True))
    assert np.ptp(first[0]) > 200  # not one run of the store


def test_the_memory_decides_and_is_told(store):
    config = config_of(store, buffer=10**6)
    chosen = choose_residence(config, 2, 5.0)
    assert chosen.resident
    assert "training data stay in memory" in chosen.told
    assert "2 networks at a time, within the 5 GB of --memory" in chosen.told
    assert 0.0 < free_memory() < 1e14
    assert "half of the memory that is free" in choose_residence(config, 1).told
    with pytest.raises(InputError, match=r"1e-06 GB of --memory: give --memory 0\.0\d+ "):
        choose_residence(config, 1, 1e-6)
    train, validation = training_lengths(store)
    assert train.sum() == 3500
    assert validation.sum() == 1350


def test_a_store_larger_than_its_memory_is_streamed(tmp_path, monkeypatch):
    path = write_synthetic_store(tmp_path / "s.zarr", [300] * 4, [0, 0, 0, 1])
    many = np.full(40_000, 20_000)  # what the store says of its missions; nothing is read
    config = config_of(path, buffer=2**17)
    monkeypatch.setattr("learn.training.resources.training_lengths", lambda *_: (many, many[:50]))
    chosen = choose_residence(config, 2, 0.5)
    assert not chosen.resident
    assert "training data are streamed from the store" in chosen.told
    assert "exceed the 0.5 GB of --memory" in chosen.told
    with MissionStore(path) as reader:
        assert len(reader) == 4


PEAK = """
import json, sys
import numpy as np
from learn.data.preparation import prepare, training_lengths
from learn.data.sequences import ahead
from twin.records.windows import buffers
def peak():
    lines = open("/proc/self/status").read().splitlines()
    return 1024 * int(next(line.split()[1] for line in lines if line.startswith("VmHWM")))
store, resident = sys.argv[1], sys.argv[2] == "resident"
with prepare(sys.argv[3], target="surge", features=("depth", "shift"), resident=resident) as data:
    data.train.take([0])  # whatever reading loads is loaded
before, total = peak(), 0.0
with prepare(store, target="surge", features=("depth", "shift"), resident=resident) as data:
    for part in ahead(data.train, buffers(data.train.lengths, 2**17)):
        total += sum(float(one.sum(dtype=float)) for one in part.targets)
print(json.dumps([peak() - before, total]))
"""


def test_memory_is_bounded_by_the_buffer_and_not_by_the_store(tmp_path):
    few, many = tmp_path / "few.zarr", tmp_path / "many.zarr"
    _write_flat(few, 4, 2**15)
    _write_flat(many, 320, 2**15)  # 10 M samples, 168 MB of sequences
    found = {}
    for way in ("resident", "streamed"):
        command = [sys.executable, "-c", PEAK, str(many), way, str(few)]
        run = subprocess.run(command, capture_output=True, text=True, check=True)
        found[way] = json.loads(run.stdout)
    assert found["resident"][1] == pytest.approx(found["streamed"][1], rel=1e-12)
    assert found["resident"][0] > 120e6
    assert found["streamed"][0] < 70e6


def _write_flat(path, missions, samples):
    """Missions of a few channels, quickly written."""
    time = PERIOD * np.arange(samples)
    wave = np.sin(time / 50.0, dtype=np.float32)
    scale = np.linspace(0.5, 1.0, missions, dtype=np.float32)[:, None]
    arrays = {
        "true_surge": 0.3 + 0.1 * scale * wave,
        "measured_depth": 50.0 + 40.0 * scale * wave,
        "measured_shift": 0.02 * scale * wave,
    }
    dataset = xr.Dataset(
        {
            name: (("mission", "time"), values, VARIABLES[name].attributes())
            for name, values in arrays.items()
        },
        {"mission": np.arange(missions), "time": time},
        {**SIMULATED_ATTRIBUTES, "schema_version": SCHEMA_VERSION},
    )
    dataset["n_samples"] = ("mission", np.full(missions, samples, np.int32))
    dataset["split"] = ("mission", np.zeros(missions, np.int8), FLAGS)
    for name in arrays:
        dataset[name].encoding["chunks"] = (1, samples)
    write_dataset(dataset, path)


def test_a_validation_of_streamed_missions_is_that_of_those_in_memory(store):
    import torch

    torch.manual_seed(0)
    network = build_network(NetworkConfig(kind="elman", inputs=len(FEATURES), hidden=4, layers=1))
    options = {"target": "surge", "features": FEATURES}
    with prepare(store, **options) as kept, prepare(store, **options, resident=False) as streamed:
        one = mean_squared_error(network, kept.train)
        assert mean_squared_error(network, streamed.train) == one


# --- Feeds: windows or single samples, every sample once


CONFIG = TrainingConfig(window=64, washin=16, full_window=128, samples=100)


@pytest.fixture(scope="module")
def sway(small_store):
    return prepare(small_store, target="sway", features=select_features(INPUT_SETS["full"]))


def feed_of(data, kind, sequences=None):
    torch.manual_seed(0)
    sequences = sequences or data.train
    config = NetworkConfig(
        kind=kind, inputs=len(data.normalisation.features), period=data.period, hidden=6, layers=1
    )
    network = build_network(config)
    return feed_for(network, sequences, CONFIG), network


@pytest.mark.parametrize(
    ("kind", "feed"), [("elman", WindowFeed), ("ema", SampleFeed), ("mlp", SampleFeed)]
)
def test_an_epoch_counts_every_sample_once(sway, kind, feed):
    made, _ = feed_of(sway, kind)
    assert isinstance(made, feed)
    groups = made.epoch(np.random.default_rng(0))
    assert len(groups) > 1
    assert sum(made.squared_error(group)[1] for group in groups) == sway.train.samples
    both = sum(made.squared_error(group)[1] for group in made.everything())
    assert both == 2 * sway.train.samples


@pytest.mark.parametrize("kind", ["ema", "mlp"])
def test_the_error_over_all_samples_is_that_of_free_runs_and_of_their_mirror_images(sway, kind):
    made, network = feed_of(sway, kind)
    with torch.no_grad():
        errors = [float(made.squared_error(group)[0]) for group in made.everything()]
    train = sway.train
    image = type(train)(
        [x * train.mirror.inputs for x in train.inputs],
        [y * np.float32(train.mirror.target) for y in train.targets],
        train.weights,
    )
    both = [mean_squared_error(network, sequences) for sequences in (train, image)]
    assert sum(errors) == pytest.approx(sum(both) * train.samples, rel=1e-4)
    assert both[0] != pytest.approx(both[1], rel=1e-4)


def test_samples_without_a_label_are_not_shown(sway):
    train = sway.train
    weights = [w.copy() for w in train.weights]
    weights[0][10:40] = 0.0
    made, _ = feed_of(sway, "ema", type(train)(train.inputs, train.targets, weights, None))
    groups = made.epoch(np.random.default_rng(0))
    assert sum(made.squared_error(group)[1] for group in groups) == train.samples - 30
