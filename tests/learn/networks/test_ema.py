"""Exponential averages: what they are, from where they start, and whatever the period."""

import numpy as np
import pytest
import torch
from navigation import trimmed_mission
from scipy.signal import lfilter

from learn.data.dataset import MissionSequence
from learn.data.sequences import Normalisation
from learn.networks.base import NetworkConfig, build_network
from learn.networks.fixed_memory import BLOCK
from learn.networks.predictor import Predictor
from twin.errors import InputError, StoreError


def ema(inputs=2, period=0.5, **sizes):
    torch.manual_seed(0)
    config = NetworkConfig(
        kind="ema", inputs=inputs, period=period, **{"hidden": 5, "layers": 1, **sizes}
    )
    return build_network(config).double()


@pytest.mark.parametrize("time", [1, 2, BLOCK - 1, BLOCK, BLOCK + 1, 5 * BLOCK + 3])
def test_averages_are_those_of_a_linear_filter_that_starts_at_the_first_sample(time):
    network = ema(memories=(2.0, 30.0))
    x = torch.randn(time, 3, 2, dtype=torch.float64)
    seen, state = network.recall(x, network.initial_state(3))
    assert torch.equal(seen[..., :2], x)
    away = x.numpy() - x[0].numpy()
    for k, memory in enumerate((2.0, 30.0)):
        rate = 1.0 - np.exp(-0.5 / memory)
        wanted = lfilter([rate], [1.0, rate - 1.0], away, axis=0) + x[0].numpy()
        found = seen[..., 2 + 2 * k : 4 + 2 * k].numpy()
        # the decays are kept in float32
        assert np.abs(found - wanted).max() < 1e-5
    assert torch.allclose(state[:, :-1], seen[-1, :, 2:])


def test_a_signal_that_rests_is_its_own_average():
    network = ema()
    x = torch.full((100, 1, 2), 3.0, dtype=torch.float64)
    seen, _ = network.recall(x, network.initial_state(1))
    assert torch.allclose(seen, torch.full_like(seen, 3.0))


def test_memories_are_seconds_whatever_the_period():
    """Twice the rate: the averages of a smooth signal hardly change."""

    def averages(period):
        time = np.arange(0.0, 60.0 + period / 2, period)
        x = torch.tensor(np.sin(time / 10.0))[:, None, None]
        network = ema(inputs=1, period=period)
        return network.recall(x, network.initial_state(1))[0][-1, 0, 1:]

    slow, fast = averages(0.5), averages(0.25)
    assert torch.allclose(slow, fast, atol=0.02)
    assert (slow - slow.mean()).abs().max() > 0.15


def test_the_mirror_turns_the_averages_of_what_it_turns():
    network = ema(inputs=3)
    signs = torch.tensor([1.0, -1.0, 1.0], dtype=torch.float64)
    turned = network.mirrored(signs)
    x = torch.randn(50, 1, 3, dtype=torch.float64)
    start = network.initial_state(1)
    assert torch.allclose(network.recall(x * signs, start)[0], network.recall(x, start)[0] * turned)
    assert turned.tolist() == [1.0, -1.0, 1.0] * 4


def test_without_a_period_it_says_who_knows_it():
    with pytest.raises(InputError, match="must know the period of the samples"):
        build_network(NetworkConfig(kind="ema", inputs=2))
    with pytest.raises(InputError, match=r"period must be a number of seconds, not -1"):
        NetworkConfig(period=-1.0)


def test_missions_of_another_period_are_refused():
    scales = Normalisation(
        features=("sin_pitch",),
        mean=(0.0,),
        scale=(1.0,),
        target="surge",
        target_mean=0.0,
        target_scale=1.0,
    )
    predictor = Predictor(ema(inputs=1).float(), scales)
    mission = MissionSequence(index=7, split="test", period=1.0, signals=trimmed_mission(20))
    with pytest.raises(StoreError, match=r"mission 7 has a sample every 1 s, and .* every 0\.5 s"):
        predictor.predict([mission])
