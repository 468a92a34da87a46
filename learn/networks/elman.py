"""Elman: the paper's network, hidden layers with context delays."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from learn.networks.base import Network
from learn.networks.c_step import CStep, transposed
from learn.networks.config import NetworkConfig
from learn.networks.context_delay import ContextDelay


class Elman(Network):
    """State columns: layer by layer, oldest output first."""

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
        """Of each layer: (delays, hidden, batch)."""
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
        arrays |= {"weight_out": self.out.weight, "bias_out": self.out.bias}
        lines += ["float out[1];", f"gt_dense(out, weight_out, bias_out, {source}, {hidden}, 1);"]
        return CStep(arrays=arrays, body="\n".join([*lines, "return out[0];"]))
