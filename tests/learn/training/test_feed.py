"""Feeds: windows or single samples, every sample once."""

import numpy as np
import pytest
import torch

from learn.data.preparation import prepare
from learn.networks.base import NetworkConfig, build_network
from learn.training.feed import SampleFeed, WindowFeed, feed_for
from learn.training.optimiser import TrainingConfig
from learn.training.trainer import mean_squared_error
from twin.navigation.features import INPUT_SETS, select_features

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
