"""Adam: torch's own (Kingma and Ba 2015)."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from learn.training.optimiser import MinibatchOptimiser
from learn.training.schedule import TrainingConfig


class AdamOptimiser(MinibatchOptimiser):
    """See the module."""

    summary = "running means of the gradient and of its squares, with a cosine schedule"

    def build(self, parameters: Iterable[Tensor], config: TrainingConfig) -> torch.optim.Optimizer:
        """See `MinibatchOptimiser`."""
        return torch.optim.Adam(parameters, lr=config.rate)
