"""Base of the networks whose memory has no weights: a recall of past inputs before a readout.

    z_t, state = recall(x_t, state)     fixed: nothing in it is trained
    y_t = read(z_t)                     a function of one sample

What is recalled does not depend on the weights. A training works it out once for whole missions,
and then sees single samples in any order: no windows, no wash-in, and no gradient through time.
"""

from __future__ import annotations

import abc

import torch
from torch import Tensor

from learn.networks.base import Network


class FixedMemory(Network):
    """Base of such networks. A kind writes `recall` and `read`."""

    @abc.abstractmethod
    def recall(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """What the readout sees, (time, batch, recalled), for inputs (time, batch, inputs), and
        the state after them."""

    @abc.abstractmethod
    def read(self, recalled: Tensor) -> Tensor:
        """Outputs (..., 1) of what is recalled, (..., recalled)."""

    def mirrored(self, signs: Tensor) -> Tensor:
        """Signs (recalled,) that the mirror port to starboard gives to what is recalled, from
        those of the inputs (inputs,). Recall must be linear but for its start."""
        recalled, _ = self.recall(signs[None, None], self.initial_state(1))
        return torch.sign(recalled[0, 0])

    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """See `Network.forward`."""
        state = self.initial_state(x.shape[1]) if state is None else state
        recalled, state = self.recall(x, state)
        return self.read(recalled), state
