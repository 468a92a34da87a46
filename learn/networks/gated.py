"""Gated networks: LSTM and GRU layers of torch, and their common base class."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from learn.networks.base import Network, NetworkConfig
from learn.networks.c_step import CStep, read_out, transposed


class Gated(Network):
    """Base class of LSTM and GRU. State columns: outputs layer by layer, then an LSTM's cells."""

    cell: ClassVar[type[nn.LSTM] | type[nn.GRU]]
    parts: ClassVar[int]
    """Number of matrices in the state: 1 for outputs, 2 for an LSTM's outputs and cells."""
    gates: ClassVar[int]
    """Number of blocks, one per gate, in a layer's weights."""
    c_units: ClassVar[str]
    """C statements that update output `h[i]` and cell `c[i]` of unit i of `hidden`. `own` and `fed`
    hold each gate's weighted sums of the layer's inputs and of its last outputs."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.cells = self.cell(config.inputs, config.hidden, config.layers)
        self.out = nn.Linear(config.hidden, 1)
        self.state_size = self.parts * config.layers * config.hidden

    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """See `Network.forward`."""
        batch = x.shape[1]
        if state is None:
            state = self.initial_state(batch)
        parts = state.view(batch, self.parts, self.config.layers, self.config.hidden)
        carried = [part.transpose(0, 1).contiguous() for part in parts.unbind(1)]
        h, end = self.cells(x, tuple(carried) if self.parts == 2 else carried[0])
        ends = end if self.parts == 2 else (end,)
        flat = torch.cat([part.transpose(0, 1).reshape(batch, -1) for part in ends], 1)
        return self.out(h), flat

    def c_step(self) -> CStep:
        """See `Network.c_step`."""
        hidden, layers = self.config.hidden, self.config.layers
        rows = self.gates * hidden
        arrays: dict[str, Tensor] = {}
        lines = [f"enum {{ hidden = {hidden} }};", f"float own[{rows}], fed[{rows}];"]
        source, size = "x", self.config.inputs
        for k in range(layers):
            for name, ours in (("own", "ih"), ("fed", "hh")):
                arrays[f"{name}_weight_{k}"] = transposed(
                    getattr(self.cells, f"weight_{ours}_l{k}")
                )
                arrays[f"{name}_bias_{k}"] = getattr(self.cells, f"bias_{ours}_l{k}")
            lines += [
                "{",
                f"    float *h = state + {k * hidden};",
                f"    gt_dense(own, own_weight_{k}, own_bias_{k}, {source}, {size}, {rows});",
                f"    gt_dense(fed, fed_weight_{k}, fed_bias_{k}, h, {hidden}, {rows});",
                *([f"    float *c = state + {(layers + k) * hidden};"] if self.parts == 2 else []),
                "    for (int i = 0; i < hidden; i++) {",
                *(f"        {line}" for line in self.c_units.strip().splitlines()),
                "    }",
                "}",
            ]
            source, size = f"state + {k * hidden}", hidden
        return read_out(arrays, lines, self.out, source)


class Gru(Gated):
    """GRU of torch."""

    summary = "gated recurrent units"
    cell = nn.GRU
    parts = 1
    gates = 3
    c_units = """
const float reset = gt_sigmoid(own[i] + fed[i]);
const float keep = gt_sigmoid(own[hidden + i] + fed[hidden + i]);
const float fresh = gt_tanh(own[2 * hidden + i] + reset * fed[2 * hidden + i]);
h[i] = fresh + keep * (h[i] - fresh);
"""


class Lstm(Gated):
    """LSTM of torch."""

    summary = "long short-term memory: gated layers with cells"
    cell = nn.LSTM
    parts = 2
    gates = 4
    c_units = """
const float in = gt_sigmoid(own[i] + fed[i]);
const float keep = gt_sigmoid(own[hidden + i] + fed[hidden + i]);
const float fresh = gt_tanh(own[2 * hidden + i] + fed[2 * hidden + i]);
const float let = gt_sigmoid(own[3 * hidden + i] + fed[3 * hidden + i]);
c[i] = keep * c[i] + in * fresh;
h[i] = let * gt_tanh(c[i]);
"""
