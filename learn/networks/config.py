"""Which network, and how large."""

from __future__ import annotations

import dataclasses
import itertools
import math

from learn.seams import NETWORKS
from twin.errors import InputError

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
