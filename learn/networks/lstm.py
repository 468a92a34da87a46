"""LSTM layers."""

from __future__ import annotations

from torch import nn

from learn.networks.gated import Gated


class Lstm(Gated):
    """torch's LSTM."""

    summary = "long short-term memory: gated layers with cells"
    cell = nn.LSTM
    parts = 2
