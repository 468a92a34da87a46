"""Gated layers: what LSTM and GRU share."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from learn.networks.base import Network
from learn.networks.config import NetworkConfig


class Gated(Network):
    """Layers of one cell. State columns: layer by layer the outputs, then the cells of an LSTM."""

    cell: ClassVar[type[nn.LSTM] | type[nn.GRU]]
    parts: ClassVar[int]
    """Matrices of the state: outputs, and the cells of an LSTM."""

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
