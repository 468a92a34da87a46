"""Every network under the one interface."""

import pytest
import torch

from learn.networks.base import NetworkConfig, build_network
from learn.seams import NETWORKS
from twin.errors import InputError

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
