"""MLP: a multilayer perceptron."""

from __future__ import annotations

from torch import Tensor, nn

from learn.networks.base import FixedMemory
from learn.networks.c_step import CStep, perceptron, transposed
from learn.networks.config import NetworkConfig


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

    def c_step(self) -> CStep:
        """See `Network.c_step`."""
        arrays, sizes = body_arrays(self.body)
        return CStep(
            arrays=arrays, body=f"(void)state;\n{perceptron(sizes, 'gt_tanh')}\nreturn out[0];"
        )


def body_arrays(body: nn.Sequential) -> tuple[dict[str, Tensor], list[int]]:
    """Weights and biases of a perceptron's layers by their names in C, and the layers' sizes."""
    layers = [layer for layer in body if isinstance(layer, nn.Linear)]
    arrays: dict[str, Tensor] = {}
    for k, layer in enumerate(layers):
        arrays |= {f"weight_{k}": transposed(layer.weight), f"bias_{k}": layer.bias}
    return arrays, [layers[0].in_features, *(layer.out_features for layer in layers)]
