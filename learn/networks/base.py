"""Base of the networks: from input features to one velocity, without feedback of measured ones.

A network sees inputs and its own state, never a velocity:

    forward(x, state) -> (y, state)   x (time, batch, inputs), y (time, batch, 1)
    step(x, state) -> (y, state)      x (batch, inputs), y (batch, 1)
    initial_state(batch)              zeros, (batch, state_size)

The state is one matrix so that every kind is carried, stored and exported the same way. Inputs and
outputs are normalised values; see `twin.navigation.features` and `learn.networks.predictor`.
`NetworkConfig` says which network, and how large.
"""

from __future__ import annotations

import abc
import dataclasses
import itertools
import math
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from learn.networks.c_step import CStep
from learn.seams import NETWORKS
from twin.errors import InputError

LSTM_WEIGHTS = 8
"""Weights of an LSTM per pair of units, four gates from the layer below and from itself: the most
of the kinds without delays and taps."""


class Network(nn.Module, abc.ABC):
    """Base of the networks. A kind says what it is and writes `forward`.

    The weights are drawn from torch's random generator when it is made. `__init__(config)` sets
    `state_size`; a kind that has a shorter way to make one step writes `step` too, else it is
    `forward` over one sample.
    """

    summary: ClassVar[str]
    """What it is, a few words for tables."""
    sizes: ClassVar[tuple[str, ...]] = ("hidden", "layers")
    """Which sizes of `NetworkConfig` it uses; others are refused on the command line."""
    state_size: int
    """Columns of the state."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        if config.inputs < 1:
            raise InputError("a network needs at least one input feature; name some features")
        self.config = config

    @classmethod
    def weights_per_pair(cls, config: NetworkConfig) -> int:
        """Weights per pair of hidden units and layer, to refuse sizes that no memory holds."""
        return LSTM_WEIGHTS

    def initial_state(self, batch: int) -> Tensor:
        """Zeros (batch, state_size): nothing is known yet."""
        return next(self.parameters()).new_zeros(batch, self.state_size)

    @abc.abstractmethod
    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Outputs (time, batch, 1) for inputs (time, batch, inputs), and the state after them."""

    def step(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Output (batch, 1) for one sample (batch, inputs), and the state after it."""
        y, state = self.forward(x[None], state)
        return y[0], state

    def c_step(self) -> CStep:
        """`step` of a single sequence in C99, for `learn export --to c`.

        Raises:
          InputError: this kind has none.
        """
        able = [name for name, kind in NETWORKS.items() if kind.c_step is not Network.c_step]
        raise InputError(
            f"network {self.config.kind!r} has no C code: give {type(self).__name__} a method "
            f"`c_step`, export to ONNX, or train a kind that has it: {', '.join(able)}"
        )

    @classmethod
    def flaw(cls, name: str) -> str:
        """Name the fault of a kind, tried on a few samples; empty where it has none."""
        if unknown := [size for size in cls.sizes if size not in SIZES]:
            return f"it names size {unknown[0]!r}; there are {', '.join(SIZES)}"
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)
            return _wrong(cls(NetworkConfig(kind=name, **TRIED)))


def build_network(config: NetworkConfig) -> Network:
    """The network that `config` describes, with fresh weights from torch's random generator."""
    return NETWORKS[config.kind](config)


TRIED_INPUTS = 3
TRIED: dict[str, Any] = {
    "inputs": TRIED_INPUTS,
    "period": 0.5,
    "hidden": 4,
    "layers": 2,
    "delays": 2,
    "kernel": 2,
    "dilation": 2,
}
TIME, BATCH = 7, 2
"""Samples and sequences of the trial."""
ROUNDING = 1e-4
"""Of float32 outputs near 1 by two ways to work them out."""


def _wrong(network: Network) -> str:
    """What a network does not do as it must; empty when all is well."""
    if not isinstance(getattr(network, "state_size", None), int):
        return "__init__ does not set state_size, the number of columns of its state"
    if not any(p.requires_grad for p in network.parameters()):
        return "it has no weights to train"
    x = torch.randn(TIME, BATCH, TRIED_INPUTS)
    network.eval()
    y, end = network(x)
    if tuple(y.shape) != (TIME, BATCH, 1):
        return f"forward gives outputs of shape {tuple(y.shape)}, not (time, batch, 1)"
    if tuple(end.shape) != (BATCH, network.state_size):
        return f"forward gives a state of shape {tuple(end.shape)}, not (batch, state_size)"
    y.square().mean().backward()
    if idle := [n for n, p in network.named_parameters() if p.requires_grad and p.grad is None]:
        return f"the output does not depend on weight {idle[0]}"
    with torch.no_grad():
        state, rows = network.initial_state(BATCH), []
        for sample in x:
            row, state = network.step(sample, state)
            rows.append(row)
        if not (_close(torch.stack(rows), y) and _close(state, end)):
            return "step after step it gives something else than forward over all samples"
        first, state = network(x[: TIME // 2])
        second, state = network(x[TIME // 2 :], state)
        if not (_close(torch.cat([first, second]), y) and _close(state, end)):
            return "forward does not go on from the state that it is given"
        changed = torch.cat([x[:-1], x[-1:] + 1.0])
        if not _close(network(changed)[0][:-1], y[:-1]):
            return "outputs depend on later samples"
    return ""


def _close(one: Tensor, other: Tensor) -> bool:
    return one.shape == other.shape and torch.allclose(one, other, atol=ROUNDING)


COUNTS = {"hidden": 4096, "layers": 64, "delays": 256, "kernel": 256, "dilation": 256}
"""The sizes that are whole numbers, and what is far beyond use for each (the paper's network has 3
layers of 50 units and 5 delays): above it a slip of the finger would end in the words of a memory
allocator."""
SIZES = (*COUNTS, "memories")
"""All that a kind can name as a size of its own."""
MOST_MEMORIES = 64
LONGEST_MEMORY = 86400.0
"""[s]"""
MOST_WEIGHTS = 1e9
"""4 GB in float32; a training holds about four times that."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """Which network, and how large; a kind uses the sizes that its class names.

    Raises:
      InputError: there is no such kind, or a size is below 1 or far beyond use.
    """

    kind: str = "ema"
    """A name of `learn.seams.NETWORKS`; elman is the paper's."""
    inputs: int = 0
    """Number of input features; the training fills it in."""
    period: float = 0.0
    """[s] between samples; the training fills it in. 0: not known."""
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
    memories: tuple[float, ...] = (2.0, 8.0, 30.0)
    """[s] ema: time constants of the averages, rising."""

    def __post_init__(self) -> None:
        kind = NETWORKS[self.kind]
        object.__setattr__(self, "memories", tuple(map(float, self.memories)))  # JSON has lists
        for name in COUNTS:
            if getattr(self, name) < 1:
                raise InputError(f"network {name} must be at least 1, not {getattr(self, name)}")
        for name, most in COUNTS.items():
            if getattr(self, name) > most:
                raise InputError(
                    f"network {name} must be at most {most}, not {getattr(self, name)}"
                )
        weights = self.layers * self.hidden**2 * kind.weights_per_pair(self)
        if weights > MOST_WEIGHTS:
            raise InputError(
                f"a network with {self.layers} layers of {self.hidden} units has about "
                f"{weights:.1e} weights, at most {MOST_WEIGHTS:.0e} are possible: take fewer "
                "units, layers or delays"
            )
        self._check_memories()
        if not (math.isfinite(self.period) and self.period >= 0.0):
            raise InputError(f"network period must be a number of seconds, not {self.period}")
        if self.inputs < 0:
            raise InputError(f"network inputs must not be negative, got {self.inputs}")

    def _check_memories(self) -> None:
        for memory in self.memories:
            if not 0.0 < memory <= LONGEST_MEMORY:
                raise InputError(
                    f"network memories are times above 0 and up to {LONGEST_MEMORY:g} s, "
                    f"not {memory}"
                )
        if not 1 <= len(self.memories) <= MOST_MEMORIES:
            raise InputError(
                f"network memories must be 1 to {MOST_MEMORIES} times, not {len(self.memories)}; "
                "a network without memory is mlp"
            )
        if any(later <= sooner for sooner, later in itertools.pairwise(self.memories)):
            raise InputError(
                f"network memories must rise, not {', '.join(f'{m:g}' for m in self.memories)}"
            )
