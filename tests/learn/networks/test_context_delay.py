"""The context-delay layer: both engines against plain autograd."""

import math

import numpy as np
import pytest
import torch

from benchmarks.layer_speed import naive_context_delay
from learn.networks.context_delay import (
    ContextDelay,
    pack_sequences,
    unpack_sequences,
)


def layer_and_data(inputs, hidden, past, time, batch, dtype, engine, seed=0):
    torch.manual_seed(seed)
    layer = ContextDelay(inputs, hidden, past, engine=engine).to(dtype)
    with torch.no_grad():
        layer.bias.uniform_(-0.3, 0.3)
    x = torch.randn(time, batch, inputs, dtype=dtype)
    history = torch.tanh(torch.randn(past, batch, hidden, dtype=dtype))
    return layer, x, history


def run_packed(layer, x, history, lanes):
    h = layer(pack_sequences(x, lanes), pack_sequences(history, lanes))
    return unpack_sequences(h, x.shape[1])


def test_gradients_pass_gradcheck_in_double():
    layer, x, history = layer_and_data(3, 4, 5, 9, 2, torch.float64, "torch")
    names = ("weight", "recurrent", "bias")
    leaves = [x, history, *(getattr(layer, name).detach() for name in names)]
    leaves = [leaf.clone().requires_grad_() for leaf in leaves]

    def function(x, history, *values):
        replaced = dict(zip(names, values, strict=True))
        packed = (pack_sequences(x, 2), pack_sequences(history, 2))
        return torch.func.functional_call(layer, replaced, packed)

    assert torch.autograd.gradcheck(function, leaves)


@pytest.mark.parametrize("engine", ["torch", "kernels"])
@pytest.mark.parametrize(
    ("inputs", "hidden", "past", "time", "batch"),
    [
        (12, 50, 5, 70, 20),  # the paper's layer, two tiles, one of them partly filled
        (7, 13, 3, 33, 16),  # sizes that fit no register tile
        (4, 10, 1, 3, 1),  # fewer samples than a summation block, one sequence
        (3, 10, 5, 2, 2),  # shorter than the delays
    ],
)
def test_engines_agree_with_plain_autograd(engine, inputs, hidden, past, time, batch):
    layer, x, history = layer_and_data(inputs, hidden, past, time, batch, torch.float32, engine)
    lanes = 16 if engine == "kernels" else batch
    weights = torch.randn(time, batch, hidden)
    results = []
    for naive in (False, True):
        layer.zero_grad()
        a, b = x.clone().requires_grad_(), history.clone().requires_grad_()
        if naive:
            h = naive_context_delay(a, b, layer.weight, layer.recurrent, layer.bias)
        else:
            h = run_packed(layer, a, b, lanes)
        (h * weights).sum().backward()
        grads = [a.grad, b.grad, *(p.grad.clone() for p in layer.parameters())]
        results.append([h.detach(), *grads])
    for ours, reference in zip(*results, strict=True):
        scale = reference.abs().max()
        assert (ours - reference).abs().max() < 2e-5 * scale


def test_state_is_carried_between_pieces():
    layer, x, _ = layer_and_data(6, 20, 5, 40, 16, torch.float32, "kernels")
    packed = pack_sequences(x, 16)
    whole = layer(packed)
    first = layer(packed[:, :23])
    second = layer(packed[:, 23:], first[:, -5:])
    assert torch.equal(torch.cat([first, second], 1), whole)


def test_step_continues_a_sequence():
    layer, x, history = layer_and_data(6, 20, 5, 12, 3, torch.float64, "torch")
    h = run_packed(layer, x, history, 3)
    states = list(history)
    for sample in x:
        past = torch.stack(states[-5:], 1).reshape(3, -1)
        states.append(layer.step(sample, past))
    assert torch.allclose(torch.stack(states[5:]), h, atol=1e-12)


def test_padded_lanes_do_not_change_gradients():
    layer, x, history = layer_and_data(5, 10, 5, 30, 3, torch.float32, "kernels")
    grads = []
    for count in (3, 16):
        layer.zero_grad()
        if count == 16:
            x = torch.nn.functional.pad(x, (0, 0, 0, 13), value=2.0)
            history = torch.nn.functional.pad(history, (0, 0, 0, 13))
        h = run_packed(layer, x, history, 16)
        h[:, :3].square().sum().backward()
        grads.append([p.grad.clone() for p in layer.parameters()])
    for a, b in zip(*grads, strict=True):
        assert torch.allclose(a, b, rtol=1e-5, atol=1e-6)


def test_kernel_tanh_is_accurate_to_float32():
    z = torch.linspace(-30, 30, 160001)[: 16 * 10000].reshape(10000, 16, 1)
    layer = ContextDelay(1, 10, 1, engine="kernels")
    with torch.no_grad():
        layer.weight.fill_(1.0)
        layer.recurrent.zero_()
        h = run_packed(layer, z, torch.zeros(1, 16, 10), 16)[..., 0]
    exact = np.tanh(z[..., 0].double().numpy())
    assert np.abs(h.double().numpy() - exact).max() < 2e-7
    assert np.abs(h.numpy()).max() <= 1.0


def test_nan_in_the_input_is_not_hidden():
    layer, x, history = layer_and_data(5, 10, 5, 8, 2, torch.float32, "kernels")
    x[3, 1, 2] = math.nan
    h = run_packed(layer, x, history, 16)
    assert torch.isnan(h[3:, 1]).all()
    assert torch.isfinite(h[:, 0]).all()
    assert torch.isfinite(h[:3]).all()


def test_kernels_refuse_what_they_cannot_compute():
    layer, x, history = layer_and_data(5, 10, 5, 8, 2, torch.float64, "kernels")
    with pytest.raises(ValueError, match=r"float32 on the CPU, not torch\.float64"):
        run_packed(layer, x, history, 16)
    layer, x, history = layer_and_data(5, 10, 5, 8, 2, torch.float32, "kernels")
    with pytest.raises(ValueError, match="16 lanes, not 2"):
        run_packed(layer, x, history, 2)
