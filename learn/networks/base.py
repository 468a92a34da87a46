"""Base of the networks: interface, sizes and checks of a network from features to one velocity.

A network gets inputs and its own state, and never a measured velocity:

    forward(x, state) -> (y, state)   x (time, batch, inputs), y (time, batch, 1)
    step(x, state) -> (y, state)      x (batch, inputs), y (batch, 1)
    initial_state(batch)              zeros, (batch, state_size)

The state is one matrix, so that all types of network are stored and exported alike. Inputs and
outputs are normalised values; see `twin.navigation.features` and `learn.networks.predictor`.
`NetworkConfig` holds the type of network and its sizes.
"""

from __future__ import annotations

import abc
import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from learn.networks.c_step import CStep
from learn.seams import NETWORKS
from twin.errors import InputError

Floats = NDArray[np.float32]

SIDE_BY_SIDE = 32
"""Maximum number of missions run together; missions of 10 000 s take about 0.5 GB."""
MOST_SAMPLES = 2**20
"""Maximum number of samples that are run together, so that fewer long missions are."""
LSTM_WEIGHTS = 8
"""Weights of an LSTM per pair of units: four gates, each from the layer below and from its own. No
type without delays or taps has more."""


class Network(nn.Module, abc.ABC):
    """Base class of networks. A subclass sets `summary` and `state_size` and writes `forward`.

    `__init__(config)` samples the weights from torch's random generator and sets `state_size`. The
    default `step` is `forward` over one sample; a subclass may write a faster one.
    """

    summary: ClassVar[str]
    """Description of the network in a few words, for tables."""
    sizes: ClassVar[tuple[str, ...]] = ("hidden", "layers")
    """Sizes of `NetworkConfig` that the network uses; the command line refuses others."""
    state_size: int
    """Number of columns of the state."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        if config.inputs < 1:
            raise InputError("a network needs at least one input feature; name some features")
        self.config, self.period = config, config.period  # 0 in files of releases up to 0.1.0

    @classmethod
    def weights_per_pair(cls, config: NetworkConfig) -> int:
        """Weights per pair of hidden units and per layer, for the limit MOST_WEIGHTS."""
        return LSTM_WEIGHTS

    def initial_state(self, batch: int) -> Tensor:
        """State before the first sample: zeros (batch, state_size)."""
        return next(self.parameters()).new_zeros(batch, self.state_size)

    @abc.abstractmethod
    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Outputs (time, batch, 1) for inputs (time, batch, inputs), and the final state."""

    def step(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Output (batch, 1) for one sample (batch, inputs), and the state after it."""
        y, state = self.forward(x[None], state)
        return y[0], state

    def c_step(self) -> CStep:
        """C99 code of `step` for a single sequence, for `learn export --to c`.

        Raises:
          InputError: this type of network has no C code.
        """
        able = [name for name, kind in NETWORKS.items() if kind.c_step is not Network.c_step]
        raise InputError(
            f"network {self.config.kind!r} has no C code: give {type(self).__name__} a method "
            f"`c_step`, export to ONNX, or train a kind that has it: {', '.join(able)}"
        )

    def run_missions(self, matrices: Sequence[Floats]) -> list[Floats]:
        """Outputs (time,) of each mission from its inputs (time, inputs), from zero state."""
        results: list[Floats] = [np.empty(0, np.float32)] * len(matrices)
        device = next(self.parameters()).device
        self.eval()
        for group in groups_by_length(np.array([len(matrix) for matrix in matrices])):
            x = np.zeros((len(matrices[group[0]]), len(group), matrices[0].shape[1]), np.float32)
            for column, k in enumerate(group):
                x[: len(matrices[k]), column] = matrices[k]
            with torch.no_grad():
                y = self(torch.from_numpy(x).to(device))[0][..., 0].cpu().numpy()
            for column, k in enumerate(group):
                results[k] = y[: len(matrices[k]), column].copy()
        return results

    def begin(self) -> Floats:
        """State of one sequence before its first sample, (1, state_size)."""
        return self.initial_state(1).cpu().numpy()

    def step_sample(self, x: Floats, state: Floats) -> tuple[float, Floats]:
        """Output for one sample (inputs,) of one sequence, and the state after it."""
        with torch.inference_mode():
            y, after = self.step(torch.from_numpy(x)[None], torch.from_numpy(state))
        return float(y[0, 0]), after.numpy()

    @classmethod
    def flaw(cls, name: str) -> str:
        """Fault of the class, found by a trial on a few samples; empty if there is none."""
        if unknown := [size for size in cls.sizes if size not in SIZES]:
            return f"it names size {unknown[0]!r}; there are {', '.join(SIZES)}"
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)
            return _broken_rule(cls(NetworkConfig(kind=name, **TRIED)))


def groups_by_length(lengths: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Group missions of similar length to run together, the longest first."""
    order = np.argsort(-lengths, kind="stable")
    groups = []
    while len(order):
        most = min(SIDE_BY_SIDE, max(1, MOST_SAMPLES // int(lengths[order[0]])))
        groups.append(order[:most])
        order = order[most:]
    return groups


def build_network(config: NetworkConfig) -> Network:
    """Build the network of `config`, with weights sampled from torch's random generator."""
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
"""TIME: number of samples in the trial. BATCH: number of sequences."""
ROUNDING = 1e-4
"""Limit of the rounding difference of float32 outputs near 1, computed in two orders."""


def _broken_rule(network: Network) -> str:
    """First rule of the interface that a network breaks; empty if there is none."""
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
"""Integer sizes and their upper limits, far above use (the paper's network has 3 layers of 50 units
and 5 delays). Because of the limits, a typing error gives a clear message instead of an allocation
failure."""
SIZES = (*COUNTS, "memories")
"""Names of all sizes that a network class may use."""
MOST_MEMORIES = 64
LONGEST_MEMORY = 86400.0
"""[s] Upper limit of an average's time constant."""
MOST_WEIGHTS = 1e9
"""Upper limit of the weights: 4 GB in float32, and about four times as much in a training."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """Type and sizes of a network; a network uses the sizes that its class names.

    Raises:
      InputError: the type is unknown, or a size is below 1 or above its limit.
    """

    kind: str = "ema"
    """Name in `learn.seams.NETWORKS`; elman is the paper's network."""
    inputs: int = 0
    """Number of input features, set by the training."""
    period: float = 0.0
    """[s] Sample period, set by the training; 0: unknown."""
    hidden: int = 50
    """Units per hidden layer."""
    layers: int = 3
    """Number of hidden layers."""
    delays: int = 5
    """elman: number of past outputs that each hidden layer gets back as input."""
    kernel: int = 3
    """tcn: taps of each convolution."""
    dilation: int = 4
    """tcn: factor of the tap spacing from layer to layer; the first layer's spacing is 1 sample."""
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
