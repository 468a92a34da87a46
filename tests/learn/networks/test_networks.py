"""Every network under the one interface."""

import math

import numpy as np
import pytest
import torch
from navigation import trimmed_mission
from scipy.signal import lfilter

from benchmarks.layer_speed import naive_context_delay
from learn.data.dataset import MissionSequence
from learn.data.sequences import Normalisation
from learn.networks.base import NetworkConfig, build_network
from learn.networks.elman import ContextDelay
from learn.networks.familiarity import LASTS_S, Tether
from learn.networks.fixed_memory import BLOCK
from learn.networks.predictor import Predictor
from learn.seams import NETWORKS
from twin.errors import InputError, StoreError

KINDS = sorted(NETWORKS)


def network_of(kind, **changes):
    torch.manual_seed(1)
    return build_network(
        NetworkConfig(kind=kind, inputs=6, period=0.5, hidden=10, layers=3, **changes)
    )


@pytest.mark.parametrize("kind", KINDS)
def test_steps_reproduce_the_whole_sequence(kind):
    network = network_of(kind).double()
    x = torch.randn(60, 3, 6, dtype=torch.float64)
    y, end = network(x)
    assert y.shape == (60, 3, 1)
    state = network.initial_state(3)
    rows = []
    for sample in x:
        row, state = network.step(sample, state)
        rows.append(row)
    assert torch.allclose(torch.stack(rows), y, atol=1e-12)
    assert torch.allclose(state, end, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cut", [2, 40])
def test_a_sequence_in_two_pieces_is_the_whole(kind, cut):
    network = network_of(kind)
    x = torch.randn(60, 3, 6)
    whole, end = network(x)
    first, state = network(x[:cut])
    second, state = network(x[cut:], state)
    assert torch.allclose(torch.cat([first, second]), whole, atol=1e-6)
    assert torch.allclose(state, end, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_the_future_does_not_reach_the_past(kind):
    network = network_of(kind)
    x = torch.randn(40, 2, 6)
    changed = x.clone()
    changed[25:] += 1.0
    a, b = network(x)[0], network(changed)[0]
    assert torch.equal(a[:25], b[:25])
    assert not torch.equal(a[25], b[25])


@pytest.mark.parametrize("kind", KINDS)
def test_every_parameter_gets_a_gradient(kind):
    network = network_of(kind)
    network(torch.randn(30, 4, 6))[0].square().mean().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().sum() > 0, name


def test_the_papers_network_has_its_size():
    network = build_network(NetworkConfig(kind="elman", inputs=12))
    first = 50 * 12 + 50 * 250 + 50
    other = 50 * 50 + 50 * 250 + 50
    assert sum(p.numel() for p in network.parameters()) == first + 2 * other + 51
    assert network.state_size == 3 * 5 * 50


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "lstn"}, "unknown network 'lstn': did you mean 'lstm'"),
        ({"hidden": 0}, "network hidden must be at least 1, not 0"),
        ({"inputs": -1}, "network inputs must not be negative, got -1"),
    ],
)
def test_wrong_configurations_say_what_is_wrong(changes, message):
    with pytest.raises(InputError, match=message):
        NetworkConfig(**changes)


def test_a_network_without_inputs_is_refused():
    with pytest.raises(InputError, match="at least one input feature"):
        build_network(NetworkConfig(kind="mlp"))


# --- The context-delay layer against plain autograd


def layer_and_data(inputs, hidden, past, time, batch, dtype, seed=0):
    torch.manual_seed(seed)
    layer = ContextDelay(inputs, hidden, past).to(dtype)
    with torch.no_grad():
        layer.bias.uniform_(-0.3, 0.3)
    x = torch.randn(time, batch, inputs, dtype=dtype)
    history = torch.tanh(torch.randn(past, batch, hidden, dtype=dtype))
    return layer, x, history


def run(layer, x, history):
    """Of sequences (time, batch, features)."""
    return layer(x.transpose(1, 2), history.transpose(1, 2)).transpose(1, 2)


def test_gradients_pass_gradcheck_in_double():
    layer, x, history = layer_and_data(3, 4, 5, 9, 2, torch.float64)
    names = ("weight", "recurrent", "bias")
    leaves = [x, history, *(getattr(layer, name).detach() for name in names)]
    leaves = [leaf.clone().requires_grad_() for leaf in leaves]

    def function(x, history, *values):
        replaced = dict(zip(names, values, strict=True))
        packed = (x.transpose(1, 2), history.transpose(1, 2))
        return torch.func.functional_call(layer, replaced, packed)

    assert torch.autograd.gradcheck(function, leaves)


@pytest.mark.parametrize(
    ("inputs", "hidden", "past", "time", "batch"),
    [
        (12, 50, 5, 70, 20),  # the paper's layer, more than one vector
        (7, 13, 3, 33, 16),  # odd sizes
        (4, 10, 1, 3, 1),  # fewer samples than delays of others, one sequence
        (3, 10, 5, 2, 2),  # shorter than the delays
    ],
)
def test_layer_agrees_with_plain_autograd(inputs, hidden, past, time, batch):
    layer, x, history = layer_and_data(inputs, hidden, past, time, batch, torch.float32)
    weights = torch.randn(time, batch, hidden)
    results = []
    for naive in (False, True):
        layer.zero_grad()
        a, b = x.clone().requires_grad_(), history.clone().requires_grad_()
        if naive:
            h = naive_context_delay(a, b, layer.weight, layer.recurrent, layer.bias)
        else:
            h = run(layer, a, b)
        (h * weights).sum().backward()
        grads = [a.grad, b.grad, *(p.grad.clone() for p in layer.parameters())]
        results.append([h.detach(), *grads])
    for ours, reference in zip(*results, strict=True):
        scale = reference.abs().max()
        assert (ours - reference).abs().max() < 2e-5 * scale


def test_state_is_carried_between_pieces():
    layer, x, _ = layer_and_data(6, 20, 5, 40, 16, torch.float32)
    packed = x.transpose(1, 2)
    whole = layer(packed)
    first = layer(packed[:23])
    second = layer(packed[23:], first[-5:])
    assert torch.equal(torch.cat([first, second]), whole)


def test_step_continues_a_sequence():
    layer, x, history = layer_and_data(6, 20, 5, 12, 3, torch.float64)
    h = run(layer, x, history)
    states = list(history)
    for sample in x:
        past = torch.stack(states[-5:], 1).reshape(3, -1)
        states.append(layer.step(sample, past))
    assert torch.allclose(torch.stack(states[5:]), h, atol=1e-12)


def test_nan_in_the_input_is_not_hidden():
    layer, x, history = layer_and_data(5, 10, 5, 8, 2, torch.float32)
    x[3, 1, 2] = math.nan
    h = run(layer, x, history)
    assert torch.isnan(h[3:, 1]).all()
    assert torch.isfinite(h[:, 0]).all()
    assert torch.isfinite(h[:3]).all()


# --- Exponential averages: what they are, from where they start, and whatever the period


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


# --- Tether: on a kind of vehicle that is new to networks, surge is held to the flight filter's


PERIOD = 0.5
TIME = np.arange(0.0, 1200.0, PERIOD)


def test_what_lasts_is_held_and_what_is_brief_is_not():
    filtered = 0.3 + 0.02 * np.sin(TIME / 40.0)
    brief = np.where((TIME > 300.0) & (TIME < 304.0), 0.1, 0.0)
    held = Tether(0.004).held(filtered + 0.15 + brief, filtered, PERIOD)
    late = TIME > 5.0 * LASTS_S
    off = held - filtered - brief
    assert np.abs(off[late] - 0.004).max() < 0.1 * 4.0 / LASTS_S + 1e-9
    near = filtered + 0.003
    np.testing.assert_array_equal(Tether(0.004).held(near, filtered, PERIOD), near)


def test_a_step_says_what_the_whole_mission_says():
    random = np.random.default_rng(0)
    filtered = np.cumsum(0.002 * random.standard_normal(TIME.size))
    surge = filtered + np.cumsum(0.002 * random.standard_normal(TIME.size))
    tether, lasting, found = Tether(0.005), 0.0, []
    for own, theirs in zip(surge, filtered, strict=True):
        lasting, off = tether.step(lasting, own - theirs, PERIOD)
        found.append(own - off)
    np.testing.assert_allclose(found, tether.held(surge, filtered, PERIOD), atol=1e-12)


def test_the_reach_is_what_half_of_the_validation_had():
    apart = [np.full(9000, 0.002), np.full(4000, -0.009)]
    assert Tether.of(apart, PERIOD).most == pytest.approx(0.002, rel=1e-3)


def test_a_begin_under_way_where_the_filter_is_at_rest_for_seconds_is_soon_forgotten():
    filtered = np.minimum(0.3, 0.06 * TIME)
    held = Tether(0.003).held(np.full(TIME.size, 0.3), filtered, PERIOD)
    assert np.abs(held - 0.3).max() < 0.02
