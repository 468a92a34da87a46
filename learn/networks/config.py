"""Which network, and how large."""

from __future__ import annotations

import dataclasses

from learn.networks.registry import NETWORKS
from twin.errors import InputError

SIZES = {"hidden": 4096, "layers": 64, "delays": 256, "kernel": 256, "dilation": 256}
"""The sizes, and what is far beyond use for each (the paper's network has 3 layers of 50 units and
5 delays): above it a slip of the finger would end in the words of a memory allocator."""
MOST_WEIGHTS = 1e9
"""4 GB in float32; a training holds about four times that."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """Which network, and how large; a kind uses the sizes that its class names.

    Raises:
      InputError: there is no such kind, or a size is below 1 or far beyond use.
    """

    kind: str = "elman"
    """A name of `learn.networks.registry.NETWORKS`; elman is the paper's."""
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
        kind = NETWORKS[self.kind]
        for name in SIZES:
            if getattr(self, name) < 1:
                raise InputError(f"network {name} must be at least 1, not {getattr(self, name)}")
        for name, most in SIZES.items():
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
        if self.inputs < 0:
            raise InputError(f"network inputs must not be negative, got {self.inputs}")
