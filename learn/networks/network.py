"""Networks from what a vehicle measures to one relative velocity, all under one interface.

Every network runs free: it sees inputs and its own state, never a velocity.

    forward(x, state) -> (y, state)   x (time, batch, inputs), y (time, batch, 1)
    step(x, state) -> (y, state)      x (batch, inputs), y (batch, 1)
    initial_state(batch)              zeros, (batch, state_size)

The state is one matrix so that every kind is carried, stored and exported the same way. Inputs and
outputs are normalised values; see `features` and `predictor`.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import torch
from torch import Tensor, nn

from learn.networks.context_delay import ContextDelay, lanes_for, pack_sequences, unpack_sequences
from twin.errors import InputError, unknown_name

Kind = Literal["elman", "lstm", "gru", "tcn", "mlp"]

MOST = {"hidden": 4096, "layers": 64, "delays": 256, "kernel": 256, "dilation": 256}
"""Sizes far beyond use (the paper's network has 3 layers of 50 units and 5 delays): above them a
slip of the finger would end in the words of a memory allocator."""
MOST_WEIGHTS = 1e9
"""4 GB in float32; a training holds about four times that."""
LSTM_WEIGHTS = 8
"""Weights of an LSTM per pair of units, four gates from the layer below and from itself: the most
of the kinds without delays and taps."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """Which network, and how large."""

    kind: Kind = "elman"
    """elman (the paper's), lstm, gru, tcn (causal convolutions) or mlp (no memory)."""
    inputs: int = 0
    """Number of input features; the training fills it in."""
    hidden: int = 50
    """Units per hidden layer."""
    layers: int = 3
    """Hidden layers."""
    delays: int = 5
    """elman: how many of its own last outputs each hidden layer is fed back."""
    kernel: int = 3
    """tcn: taps of each convolution."""
    dilation: int = 4
    """tcn: ratio of the tap spacings of one layer and the layer before; the first is 1 sample."""

    def __post_init__(self) -> None:
        if self.kind not in NETWORKS:
            raise InputError(unknown_name("network", self.kind, NETWORKS))
        for name in ("hidden", "layers", "delays", "kernel", "dilation"):
            if getattr(self, name) < 1:
                raise InputError(f"network {name} must be at least 1, not {getattr(self, name)}")
        for name, most in MOST.items():
            if getattr(self, name) > most:
                raise InputError(
                    f"network {name} must be at most {most}, not {getattr(self, name)}"
                )
        per_pair = {"elman": 1 + self.delays, "tcn": self.kernel}.get(self.kind, LSTM_WEIGHTS)
        if (weights := self.layers * self.hidden**2 * per_pair) > MOST_WEIGHTS:
            raise InputError(
                f"a network with {self.layers} layers of {self.hidden} units has about "
                f"{weights:.1e} weights, at most {MOST_WEIGHTS:.0e} are possible: take fewer "
                "units, layers or delays"
            )
        if self.inputs < 0:
            raise InputError(f"network inputs must not be negative, got {self.inputs}")


class Network(nn.Module):
    """Base of the networks."""

    state_size: int
    """Columns of the state."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        if config.inputs < 1:
            raise InputError("a network needs at least one input feature; name some features")
        self.config = config

    def initial_state(self, batch: int) -> Tensor:
        """Zeros (batch, state_size): nothing is known yet."""
        return next(self.parameters()).new_zeros(batch, self.state_size)

    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Outputs (time, batch, 1) for inputs (time, batch, inputs), and the state after them."""
        raise NotImplementedError

    def step(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Output (batch, 1) for one sample (batch, inputs), and the state after it."""
        y, state = self.forward(x[None], state)
        return y[0], state

    def parameter_count(self) -> int:
        """Number of trained numbers."""
        return sum(p.numel() for p in self.parameters())


class Elman(Network):
    """The paper's network: hidden layers that are fed back with their own last outputs.

    State columns: layer by layer, oldest output first.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        sizes = [config.inputs] + [config.hidden] * (config.layers - 1)
        layers = [ContextDelay(size, config.hidden, config.delays) for size in sizes]
        self.hidden = nn.ModuleList(layers)
        self.out = nn.Linear(config.hidden, 1)
        self.state_size = config.layers * config.delays * config.hidden

    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """See `Network.forward`."""
        batch = x.shape[1]
        lanes = lanes_for(x, batch)
        h = pack_sequences(x, lanes)
        histories = self._histories(state, lanes)
        ends = []
        for layer, history in zip(self.hidden, histories, strict=True):
            h = layer(h, history)
            ends.append(self._last(h, history, batch))
        y = torch.matmul(self.out.weight, h) + self.out.bias
        return unpack_sequences(y, batch), torch.cat(ends, 1)

    def _histories(self, state: Tensor | None, lanes: int) -> list[Tensor | None]:
        if state is None:
            return [None] * self.config.layers
        parts = state.view(-1, self.config.layers, self.config.delays, self.config.hidden)
        return [pack_sequences(part.transpose(0, 1), lanes) for part in parts.unbind(1)]

    def _last(self, h: Tensor, history: Tensor | None, batch: int) -> Tensor:
        delays = self.config.delays
        last = h[:, -delays:]
        missing = delays - last.shape[1]
        if missing:
            tiles, _, hidden, lanes = h.shape
            before = h.new_zeros(tiles, delays, hidden, lanes) if history is None else history
            last = torch.cat([before[:, -missing:], last], 1)
        return unpack_sequences(last, batch).transpose(0, 1).reshape(batch, -1)

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


class Gated(Network):
    """LSTM or GRU layers. State columns: layer by layer the outputs, then the cells of an LSTM."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        kind = nn.LSTM if config.kind == "lstm" else nn.GRU
        self.cells = kind(config.inputs, config.hidden, config.layers)
        self.out = nn.Linear(config.hidden, 1)
        self.parts = 2 if config.kind == "lstm" else 1
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


class CausalConvolutions(Network):
    """Temporal convolutions that look back only, with a residual path around each layer.

    State columns: layer by layer the inputs that the next sample still needs, oldest first.
    """

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


class Memoryless(Network):
    """A multilayer perceptron that sees one sample at a time: what memory is measured against."""

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


NETWORKS: dict[str, type[Network]] = {
    "elman": Elman,
    "lstm": Gated,
    "gru": Gated,
    "tcn": CausalConvolutions,
    "mlp": Memoryless,
}
"""Every kind of network by name."""


def build_network(config: NetworkConfig) -> Network:
    """The network that `config` describes, with fresh weights from torch's random generator."""
    return NETWORKS[config.kind](config)


class OneStep(nn.Module):
    """`step` as a module's forward, the shape that an exporter wants: (x, state) to (y, state)."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """x (batch, inputs), state (batch, state_size) to y (batch, 1) and the next state."""
        return self.network.step(x, state)
