"""A training that starts from a run keeps what the run knows: held-back missions decide."""

import dataclasses

import numpy as np
import torch

from learn.data.sequences import Sequences
from learn.networks.base import NetworkConfig, build_network
from learn.training.held_back import HeldBack, HeldRows
from learn.training.optimiser import TrainingConfig
from learn.training.trainer import Trainer

CONFIG = NetworkConfig(kind="mlp", hidden=8, layers=1)


def sequences(wanted, missions, seed):
    rng = np.random.default_rng(seed)
    x = [rng.standard_normal((200, 2)).astype(np.float32) for _ in range(missions)]
    y = [wanted(values).astype(np.float32) for values in x]
    return Sequences(x, y, [np.ones(200, np.float32)] * missions)


def start_of(wanted):
    """Weights of a network that learned a law from many missions."""
    config = TrainingConfig(seconds=0.0, epochs=60, samples=256)
    data = sequences(wanted, 20, 1)
    trained = Trainer(CONFIG, config, data, sequences(wanted, 4, 2), target_scale=1.0).run()
    return {name: value.clone() for name, value in trained.network.state_dict().items()}


def rows_of(start, held):
    network = build_network(dataclasses.replace(CONFIG, inputs=held.width))
    network.load_state_dict(start)
    return HeldRows.of(network, held.inputs, held.targets)


def careful(start, train, held):
    config, rows = TrainingConfig(seconds=0.0, epochs=40, samples=64), rows_of(start, held)
    return Trainer(CONFIG, config, train, None, target_scale=1.0, start=start, held=rows)


def law(x):
    return 0.5 * x[:, 0] - 0.2 * x[:, 1]


def test_missions_that_contradict_the_held_back_ones_change_nothing():
    start = start_of(law)
    trained = careful(start, sequences(lambda x: law(x) + 1.0, 3, 5), sequences(law, 40, 6)).run()
    for name, value in trained.network.state_dict().items():
        torch.testing.assert_close(value, start[name], rtol=0.0, atol=0.0)
    assert trained.stopped_early


def test_missions_that_agree_with_the_held_back_ones_teach():
    start, held = start_of(law), sequences(lambda x: 2.0 * law(x), 40, 6)
    trainer = careful(start, sequences(lambda x: 2.0 * law(x), 20, 5), held)
    network = build_network(trainer.network_config)
    network.load_state_dict(start)
    before = HeldBack(network, rows_of(start, held)).judge()
    network.load_state_dict(trainer.run().network.state_dict())
    after = HeldBack(network, rows_of(start, held)).judge()
    assert after.mse < 0.5 * before.mse
    assert after.bias <= before.bias
