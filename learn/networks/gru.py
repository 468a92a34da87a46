"""GRU layers."""

from __future__ import annotations

from torch import nn

from learn.networks.gated import Gated


class Gru(Gated):
    """torch's GRU."""

    summary = "gated recurrent units"
    cell = nn.GRU
    parts = 1
