"""The paper's hidden layer: tanh units that are fed back with their own last outputs.

    h_t = tanh(W x_t + sum_{i=1..past} U_i h_{t-i} + b)

`ContextDelay` works on tensors laid out as (tiles, time, features, lanes), where tiles * lanes is
the batch. There the past states of one step are one contiguous block, so that each step is one
matrix product of (hidden, past * hidden) with (past * hidden, lanes), forward and backward, and
every weight gradient is one sum over all times. `pack_sequences` and `unpack_sequences` change the
layout.

Two engines compute the same numbers: the vector kernels (float32 on a CPU, `vector_kernels`) and
plain torch operations (any type and device).
"""

from __future__ import annotations

import math
from typing import Any, Literal

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

Engine = Literal["auto", "kernels", "torch"]


def use_kernels(x: Tensor, engine: Engine = "auto") -> bool:
    """Whether the vector kernels handle this tensor.

    Raises:
        ValueError: the kernels are demanded for a tensor that they cannot handle.
    """
    fits = x.device.type == "cpu" and x.dtype == torch.float32
    if engine == "kernels" and not fits:
        raise ValueError(f"the vector kernels need float32 on the CPU, not {x.dtype} on {x.device}")
    return fits and engine != "torch"


def lanes_for(x: Tensor, batch: int, engine: Engine = "auto") -> int:
    """Sequences side by side: what the vector kernels demand, else the whole batch."""
    if use_kernels(x, engine):
        from learn.networks.vector_kernels import LANES

        return LANES
    return batch


def pack_sequences(x: Tensor, lanes: int) -> Tensor:
    """(time, batch, features) as (tiles, time, features, lanes); missing sequences are zeros."""
    time, batch, features = x.shape
    tiles = max(1, -(-batch // lanes))
    if tiles * lanes != batch:
        x = nn.functional.pad(x, (0, 0, 0, tiles * lanes - batch))
    return x.view(time, tiles, lanes, features).permute(1, 0, 3, 2).contiguous()


def unpack_sequences(packed: Tensor, batch: int) -> Tensor:
    """(tiles, time, features, lanes) as (time, batch, features)."""
    tiles, time, features, lanes = packed.shape
    return packed.permute(1, 0, 3, 2).reshape(time, tiles * lanes, features)[:, :batch]


class ContextDelay(nn.Module):
    """One hidden layer with `past` context delays.

    Parameters: `weight` (hidden, inputs), `recurrent` (hidden, past * hidden) with the oldest
    delay first, `bias` (hidden,).
    """

    def __init__(self, inputs: int, hidden: int, past: int, engine: Engine = "auto") -> None:
        super().__init__()
        self.inputs, self.hidden, self.past, self.engine = inputs, hidden, past, engine
        self.weight = nn.Parameter(torch.empty(hidden, inputs))
        self.recurrent = nn.Parameter(torch.empty(hidden, past * hidden))
        self.bias = nn.Parameter(torch.empty(hidden))
        self.reset_parameters()

    def reset_parameters(self) -> None:
        """Glorot's uniform input weights; recurrent ones uniform with the same fan, all delays."""
        nn.init.xavier_uniform_(self.weight)
        bound = 1.0 / math.sqrt(self.past * self.hidden)
        nn.init.uniform_(self.recurrent, -bound, bound)
        nn.init.zeros_(self.bias)

    def forward(self, x: Tensor, history: Tensor | None = None) -> Tensor:
        """States after every sample.

        Args:
          x: (tiles, time, inputs, lanes).
          history: (tiles, past, hidden, lanes), oldest first; None is zeros.

        Returns:
          (tiles, time, hidden, lanes).
        """
        if history is None:
            history = x.new_zeros(x.shape[0], self.past, self.hidden, x.shape[3])
        function = _KernelContextDelay if use_kernels(x, self.engine) else _TorchContextDelay
        return function.apply(x, history, self.weight, self.recurrent, self.bias)

    def step(self, x: Tensor, history: Tensor) -> Tensor:
        """State (batch, hidden) after x (batch, inputs); history (batch, past * hidden)."""
        return torch.tanh(x @ self.weight.T + history @ self.recurrent.T + self.bias)


def transposed_recurrent(recurrent: Tensor, past: int) -> Tensor:
    """(hidden, past * hidden), oldest first, as the backward pass needs it: transposed blocks,
    shortest delay first, so that row block i multiplies the gradient i + 1 samples later."""
    hidden = recurrent.shape[0]
    blocks = recurrent.view(hidden, past, hidden).flip(1)
    return blocks.permute(2, 1, 0).reshape(hidden, past * hidden)


class _TorchContextDelay(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: Tensor, history: Tensor, weight: Tensor, recurrent: Tensor, bias: Tensor
    ) -> Tensor:
        tiles, time, _, lanes = x.shape
        past, hidden = history.shape[1:3]
        states = x.new_empty(tiles, past + time, hidden, lanes)
        states[:, :past] = history
        states[:, past:] = torch.matmul(weight, x) + bias[:, None]
        for tile in states:
            for t in range(time):
                block = tile[t : t + past].view(past * hidden, lanes)
                tile[t + past].addmm_(recurrent, block).tanh_()
        ctx.past = past
        ctx.save_for_backward(x, states, weight, recurrent)
        return states[:, past:]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, states, weight, recurrent = ctx.saved_tensors
        past = ctx.past
        tiles, time, _, lanes = x.shape
        hidden = weight.shape[0]
        transposed = transposed_recurrent(recurrent, past)
        deltas = x.new_zeros(tiles, time + past, hidden, lanes)
        deltas[:, :time] = gradient
        slopes = 1.0 - states[:, past:].square()
        grad_recurrent = torch.zeros_like(recurrent)
        for tile, state, slope in zip(deltas, states, slopes, strict=True):
            for t in range(time - 1, -1, -1):
                after = tile[t + 1 : t + 1 + past].view(past * hidden, lanes)
                tile[t].addmm_(transposed, after).mul_(slope[t])
                grad_recurrent.addmm_(tile[t], state[t : t + past].view(past * hidden, lanes).T)
        inner = deltas[:, :time]
        grad_weight = torch.einsum("nthl,ntfl->hf", inner, x)
        grad_bias = inner.sum((0, 1, 3))
        grad_x = torch.matmul(weight.T, inner) if ctx.needs_input_grad[0] else None
        grad_history = None
        if ctx.needs_input_grad[1]:
            grad_history = _history_gradient(deltas, transposed, past)
        return grad_x, grad_history, grad_weight, grad_recurrent, grad_bias


def _history_gradient(deltas: Tensor, transposed: Tensor, past: int) -> Tensor:
    """Gradient of the initial states: they reach only the first `past` samples."""
    tiles, _, hidden, lanes = deltas.shape
    early = torch.cat([deltas.new_zeros(tiles, past, hidden, lanes), deltas[:, : 2 * past]], 1)
    rows = []
    for k in range(past):
        block = early[:, k + 1 : k + 1 + past].reshape(tiles, past * hidden, lanes)
        rows.append(torch.matmul(transposed, block))
    return torch.stack(rows, 1)


class _KernelContextDelay(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: Tensor, history: Tensor, weight: Tensor, recurrent: Tensor, bias: Tensor
    ) -> Tensor:
        from learn.networks import vector_kernels as kernels

        tiles, time, inputs, lanes = x.shape
        past, hidden = history.shape[1:3]
        if lanes != kernels.LANES:
            raise ValueError(f"the vector kernels need {kernels.LANES} lanes, not {lanes}")
        rows = kernels.padded_size(hidden)
        columns = kernels.padded_size(inputs) if ctx.needs_input_grad[0] else inputs + inputs % 2
        x = _rows_in_runs(x, columns)
        states = x.new_empty(tiles, past + time, rows, lanes)
        states[:, :past, :hidden] = history
        states[:, :past, hidden:] = 0.0
        wide = _pad_columns(recurrent.detach(), past, hidden, rows)
        packed = kernels.pack(_pad_columns(weight.detach(), 1, inputs, columns).numpy(), rows)
        packed_recurrent = kernels.pack(wide.numpy(), rows)
        padded_bias = nn.functional.pad(bias.detach(), (0, rows - hidden)).contiguous()
        kernels.forward(
            tiles, time, columns, rows, past, *_place(x), *_place(states), padded_bias.data_ptr(),
            packed.ctypes.data, packed_recurrent.ctypes.data,
        )  # fmt: skip
        ctx.past, ctx.inputs, ctx.hidden = past, inputs, hidden
        ctx.save_for_backward(x, states, weight, wide)
        return states[:, past:, :hidden]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        from learn.networks import vector_kernels as kernels

        x, states, weight, wide = ctx.saved_tensors
        past, inputs, hidden = ctx.past, ctx.inputs, ctx.hidden
        tiles, time, columns, lanes = x.shape
        rows = states.shape[2]
        gradient = _rows_in_runs(gradient, rows)
        square = nn.functional.pad(wide, (0, 0, 0, rows - hidden)) if rows != hidden else wide
        transposed = transposed_recurrent(square, past)
        packed = kernels.pack(transposed.numpy(), rows)
        deltas = x.new_empty(tiles, time + past, rows, lanes)
        deltas[:, time:] = 0.0
        first_state = states.data_ptr() + states.element_size() * past * rows * lanes
        kernels.backward(
            tiles, time, rows, past, *_place(gradient), first_state, states.stride(0),
            deltas.data_ptr(), packed.ctypes.data,
        )  # fmt: skip
        grad_recurrent = _outer_sum(deltas, states, time, past)[:hidden, :, :hidden]
        grad_weight = _outer_sum(deltas, x, time, 1)[:hidden, 0, :inputs]
        lane_sums = x.new_zeros(rows, lanes)
        kernels.lane_sums(tiles, time, rows, *_place(deltas), lane_sums.data_ptr())
        grad_x = grad_history = None
        if ctx.needs_input_grad[0]:
            grad_x = x.new_empty(tiles, time, columns, lanes)
            wide_weight = _pad_columns(weight.detach().T, 1, hidden, rows)
            packed_weight = kernels.pack(wide_weight.numpy(), columns)
            address = packed_weight.ctypes.data
            kernels.products(
                tiles, time, rows, columns, address, *_place(deltas), grad_x.data_ptr()
            )
            grad_x = grad_x[:, :, :inputs]
        if ctx.needs_input_grad[1]:
            grad_history = _history_gradient(deltas, transposed, past)[:, :, :hidden]
        return (
            grad_x,
            grad_history,
            grad_weight,
            grad_recurrent.reshape(hidden, past * hidden),
            lane_sums[:hidden].sum(1),
        )


def _place(x: Tensor) -> tuple[int, int]:
    """As kernels take a tensor: its address, and floats from one tile to the next."""
    return x.data_ptr(), x.stride(0)


def _rows_in_runs(x: Tensor, rows: int) -> Tensor:
    """`x` with `rows` features (zeros added) and no gaps except between tiles."""
    if x.shape[2] != rows:
        return nn.functional.pad(x, (0, 0, 0, rows - x.shape[2])).contiguous()
    gapless = x.stride()[1:] == (rows * x.shape[3], x.shape[3], 1)
    return x if gapless else x.contiguous()


def _pad_columns(weight: Tensor, blocks: int, size: int, padded: int) -> Tensor:
    """Each of the `blocks` column blocks of `size` filled up with zeros to `padded`."""
    rows = weight.shape[0]
    wide = nn.functional.pad(weight.reshape(rows, blocks, size), (0, padded - size))
    return wide.reshape(rows, blocks * padded).contiguous()


def _outer_sum(left: Tensor, right: Tensor, time: int, delays: int) -> Tensor:
    """Sum over tiles, times and lanes of left[t] right[t + d]^T: (rows, delays, columns)."""
    from learn.networks import vector_kernels as kernels

    tiles, _, rows, _ = left.shape
    columns = right.shape[2]
    sums = left.new_zeros(rows, delays, columns, kernels.WIDTH)
    scratch = left.new_empty(kernels.scratch_size(rows, columns, delays))
    kernels.outer_sums(
        tiles, time, delays, rows, columns, *_place(left), *_place(right), scratch.data_ptr(),
        sums.data_ptr(),
    )  # fmt: skip
    return sums.sum(-1)
