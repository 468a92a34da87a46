"""TCN: temporal convolutional network, with causal convolutions over time."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from learn.networks.base import Network, NetworkConfig
from learn.networks.c_step import CStep, read_out, transposed


class CausalConvolutions(Network):
    """Causal convolutions. State columns: each layer's past inputs in reach, oldest first."""

    summary = "convolutions over time that look back only, with a residual path around each layer"
    sizes = ("hidden", "layers", "kernel", "dilation")

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        sizes = [config.inputs] + [config.hidden] * (config.layers - 1)
        self.taps = nn.ModuleList(
            nn.Conv1d(size, config.hidden, config.kernel, dilation=config.dilation**layer)
            for layer, size in enumerate(sizes)
        )
        self.out = nn.Linear(config.hidden, 1)
        self.reach = [(config.kernel - 1) * config.dilation**k for k in range(config.layers)]
        self.widths = [reach * size for reach, size in zip(self.reach, sizes, strict=True)]
        self.state_size = sum(self.widths)

    @classmethod
    def weights_per_pair(cls, config: NetworkConfig) -> int:
        """See `Network.weights_per_pair`."""
        return config.kernel

    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """See `Network.forward`."""
        batch = x.shape[1]
        if state is None:
            state = self.initial_state(batch)
        h = x.permute(1, 2, 0)
        ends = []
        parts = state.split(self.widths, 1)
        for taps, reach, part in zip(self.taps, self.reach, parts, strict=True):
            past = part.reshape(batch, reach, h.shape[1]).transpose(1, 2)
            seen = torch.cat([past, h], 2)
            ends.append(seen[:, :, seen.shape[2] - reach :].transpose(1, 2).reshape(batch, -1))
            new = torch.tanh(taps(seen))
            h = new + h if new.shape == h.shape else new
        return self.out(h.permute(2, 0, 1)), torch.cat(ends, 1)

    def c_step(self) -> CStep:
        """See `Network.c_step`."""
        config = self.config
        arrays: dict[str, Tensor] = {}
        lines: list[str] = []
        source, size, place = "x", config.inputs, 0
        for k, taps in enumerate(self.taps):
            assert isinstance(taps, nn.Conv1d)
            assert taps.bias is not None
            arrays[f"bias_{k}"] = taps.bias
            lines += [f"float h{k}[{config.hidden}];", f"memcpy(h{k}, bias_{k}, sizeof h{k});"]
            for tap in range(config.kernel):
                arrays[f"tap_{k}_{tap}"] = transposed(taps.weight[:, :, tap])
                row = place + tap * config.dilation**k * size
                seen = source if tap == config.kernel - 1 else f"state + {row}"
                lines.append(f"gt_add(h{k}, tap_{k}_{tap}, {seen}, {size}, {config.hidden});")
            lines.append(f"gt_tanhs(h{k}, {config.hidden});")
            if size == config.hidden:
                lines.append(f"for (int i = 0; i < {size}; i++) h{k}[i] += {source}[i];")
            if self.reach[k]:
                lines.append(f"gt_append(state + {place}, {self.reach[k]}, {size}, {source});")
            source, size, place = f"h{k}", config.hidden, place + self.widths[k]
        return read_out(arrays, [*lines, "(void)state;"], self.out, source)
