"""The context-delay layer against plain autograd."""

import math

import pytest
import torch

from benchmarks.layer_speed import naive_context_delay
from learn.networks.elman import ContextDelay


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
