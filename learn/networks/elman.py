"""Elman: the paper's network of hidden tanh layers, whose past outputs are inputs to themselves.

    h_t = tanh(W x_t + sum_{i=1..past} U_i h_{t-i} + b)

`ContextDelay` uses tensors laid out as (time, features, batch), so that the past states of a step
are one contiguous block. Each step, forward or backward, is one matrix product of (hidden,
past * hidden) with (past * hidden, batch). Each weight gradient is one product over all times.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from learn.networks.base import Network, NetworkConfig
from learn.networks.c_step import CStep, read_out, transposed


class Elman(Network):
    """Elman network. State columns: layer by layer, oldest output first."""

    summary = "the paper's: hidden layers that are fed back with their own last outputs"
    sizes = ("hidden", "layers", "delays")

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        sizes = [config.inputs] + [config.hidden] * (config.layers - 1)
        layers = [ContextDelay(size, config.hidden, config.delays) for size in sizes]
        self.hidden = nn.ModuleList(layers)
        self.out = nn.Linear(config.hidden, 1)
        self.state_size = config.layers * config.delays * config.hidden

    @classmethod
    def weights_per_pair(cls, config: NetworkConfig) -> int:
        """See `Network.weights_per_pair`."""
        return 1 + config.delays

    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """See `Network.forward`."""
        h = x.transpose(1, 2).contiguous()
        ends = []
        for layer, history in zip(self.hidden, self._histories(x, state), strict=True):
            h = layer(h, history)
            ends.append(self._last(history, h))
        y = torch.matmul(self.out.weight, h) + self.out.bias
        return y.transpose(1, 2), torch.cat(ends, 1)

    def _last(self, history: Tensor, h: Tensor) -> Tensor:
        delays = self.config.delays
        return torch.cat([history, h[-delays:]])[-delays:].permute(2, 0, 1).flatten(1)

    def _histories(self, x: Tensor, state: Tensor | None) -> tuple[Tensor, ...]:
        """Past activations of each layer, shape (delays, hidden, batch)."""
        shape = (x.shape[1], self.config.layers, self.config.delays, self.config.hidden)
        parts = x.new_zeros(shape) if state is None else state.view(shape)
        return parts.permute(1, 2, 3, 0).unbind()

    def step(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """See `Network.step`."""
        width = self.config.delays * self.config.hidden
        ends = []
        h = x
        for layer, history in zip(self.hidden, state.split(width, 1), strict=True):
            assert isinstance(layer, ContextDelay)
            h = layer.step(h, history)
            ends.append(torch.cat([history[:, self.config.hidden :], h], 1))
        return self.out(h), torch.cat(ends, 1)

    def c_step(self) -> CStep:
        """See `Network.c_step`."""
        hidden, delays = self.config.hidden, self.config.delays
        arrays: dict[str, Tensor] = {}
        lines, source = [], "x"
        for k, layer in enumerate(self.hidden):
            assert isinstance(layer, ContextDelay)
            arrays |= {
                f"weight_{k}": transposed(layer.weight),
                f"recurrent_{k}": transposed(layer.recurrent),
                f"bias_{k}": layer.bias,
            }
            past = f"state + {k * delays * hidden}"
            lines += [
                f"float h{k}[{hidden}];",
                f"gt_dense(h{k}, weight_{k}, bias_{k}, {source}, {layer.inputs}, {hidden});",
                f"gt_add(h{k}, recurrent_{k}, {past}, {delays * hidden}, {hidden});",
                f"gt_tanhs(h{k}, {hidden});",
                f"gt_append({past}, {delays}, {hidden}, h{k});",
            ]
            source = f"h{k}"
        return read_out(arrays, lines, self.out, source)


class ContextDelay(nn.Module):
    """Hidden layer that gets its last `past` outputs as inputs.

    Parameters: `weight` (hidden, inputs), `recurrent` (hidden, past * hidden) with the oldest
    delay first, `bias` (hidden,).
    """

    def __init__(self, inputs: int, hidden: int, past: int) -> None:
        super().__init__()
        self.inputs, self.hidden, self.past = inputs, hidden, past
        self.weight = nn.Parameter(torch.empty(hidden, inputs))
        self.recurrent = nn.Parameter(torch.empty(hidden, past * hidden))
        self.bias = nn.Parameter(torch.empty(hidden))
        self.reset_parameters()

    def reset_parameters(self) -> None:
        """Sample weights: Glorot's uniform rule, for recurrent ones with fan-in past * hidden."""
        nn.init.xavier_uniform_(self.weight)
        bound = 1.0 / math.sqrt(self.past * self.hidden)
        nn.init.uniform_(self.recurrent, -bound, bound)
        nn.init.zeros_(self.bias)

    def forward(self, x: Tensor, history: Tensor | None = None) -> Tensor:
        """States after every sample.

        Args:
          x: (time, inputs, batch).
          history: (past, hidden, batch), oldest first; None is zeros.

        Returns:
          (time, hidden, batch).
        """
        if history is None:
            history = x.new_zeros(self.past, self.hidden, x.shape[2])
        return _Recurrence.apply(x, history, self.weight, self.recurrent, self.bias)

    def step(self, x: Tensor, history: Tensor) -> Tensor:
        """State (batch, hidden) after x (batch, inputs); history (batch, past * hidden)."""
        return torch.tanh(x @ self.weight.T + history @ self.recurrent.T + self.bias)


class _Recurrence(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: Tensor, history: Tensor, weight: Tensor, recurrent: Tensor, bias: Tensor
    ) -> Tensor:
        time, _, batch = x.shape
        past, hidden = history.shape[:2]
        states = x.new_empty(past + time, hidden, batch)
        states[:past] = history
        torch.matmul(weight, x, out=states[past:])
        states[past:] += bias[:, None]
        blocks = _blocks(states, past, time)
        for state, before in zip(states[past:].unbind(), blocks, strict=True):
            state.addmm_(recurrent, before).tanh_()
        ctx.save_for_backward(x, states, weight, recurrent)
        return states[past:]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, states, weight, recurrent = ctx.saved_tensors
        time, _, batch = x.shape
        past, hidden = states.shape[0] - time, states.shape[1]
        # transposed, shortest delay first: block i multiplies the gradient i + 1 samples later
        turned = recurrent.view(hidden, past, hidden).flip(1).permute(2, 1, 0)
        transposed = turned.reshape(hidden, past * hidden)
        deltas = x.new_zeros(past + time + past, hidden, batch)
        inner = deltas[past : past + time]
        slopes = 1.0 - states[past:].square()
        blocks = _blocks(deltas[past + 1 :], past, time)
        inner.copy_(gradient)
        steps = zip(inner.unbind(), blocks, slopes.unbind(), strict=True)
        for delta, after, slope in reversed(list(steps)):
            delta.addmm_(transposed, after).mul_(slope)
        rows, columns = _by_feature(inner), _by_feature(states)
        sums = [rows @ columns[:, d * batch : (d + time) * batch].T for d in range(past)]
        early = _blocks(deltas[1:], past, past)
        return (
            torch.matmul(weight.T, inner) if ctx.needs_input_grad[0] else None,
            torch.stack([transposed @ block for block in early])
            if ctx.needs_input_grad[1]
            else None,
            rows @ _by_feature(x).T,
            torch.cat(sums, 1),
            rows.sum(1),
        )


def _blocks(x: Tensor, past: int, count: int) -> tuple[Tensor, ...]:
    """Views of x (time, features, batch): for each of the first `count` times, the `past` rows that
    begin there, as one matrix (past * features, batch)."""
    _, features, batch = x.shape
    shape = (count, past * features, batch)
    return x.as_strided(shape, (features * batch, batch, 1), x.storage_offset()).unbind()


def _by_feature(x: Tensor) -> Tensor:
    """Reshape (time, features, batch) to (features, time * batch)."""
    return x.transpose(0, 1).reshape(x.shape[1], -1)
