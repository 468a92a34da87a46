"""MLP: a multilayer perceptron."""

from __future__ import annotations

from torch import Tensor, nn

from learn.networks.config import NetworkConfig
from learn.networks.memory import FixedMemory


class Memoryless(FixedMemory):
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

    def recall(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """The sample itself."""
        return x, state

    def read(self, recalled: Tensor) -> Tensor:
        """See `FixedMemory.read`."""
        return self.body(recalled)
