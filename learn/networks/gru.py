"""GRU layers."""

from __future__ import annotations

from torch import nn

from learn.networks.gated import Gated


class Gru(Gated):
    """torch's GRU."""

    summary = "gated recurrent units"
    cell = nn.GRU
    parts = 1
    gates = 3
    c_units = """
const float reset = gt_sigmoid(own[i] + fed[i]);
const float keep = gt_sigmoid(own[hidden + i] + fed[hidden + i]);
const float fresh = tanhf(own[2 * hidden + i] + reset * fed[2 * hidden + i]);
h[i] = fresh + keep * (h[i] - fresh);
"""
