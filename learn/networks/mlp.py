"""MLP: a multilayer perceptron."""

from __future__ import annotations

from torch import Tensor, nn

from learn.networks.base import Network
from learn.networks.config import NetworkConfig


class Memoryless(Network):
    """It sees one sample at a time: what memory is measured against."""

    summary = "a multilayer perceptron without memory"
    state_size = 0

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        layers: list[nn.Module] = []
        size = config.inputs
        for _ in range(config.layers):
            layers += [nn.Linear(size, config.hidden), nn.Tanh()]
            size = config.hidden
        self.body = nn.Sequential(*layers, nn.Linear(size, 1))

    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """See `Network.forward`."""
        return self.body(x), self.initial_state(x.shape[1]) if state is None else state
