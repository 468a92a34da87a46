"""LSTM layers."""

from __future__ import annotations

from torch import nn

from learn.networks.gated import Gated


class Lstm(Gated):
    """torch's LSTM."""

    summary = "long short-term memory: gated layers with cells"
    cell = nn.LSTM
    parts = 2
    gates = 4
    c_units = """
const float in = gt_sigmoid(own[i] + fed[i]);
const float keep = gt_sigmoid(own[hidden + i] + fed[hidden + i]);
const float fresh = tanhf(own[2 * hidden + i] + fed[2 * hidden + i]);
const float let = gt_sigmoid(own[3 * hidden + i] + fed[3 * hidden + i]);
c[i] = keep * c[i] + in * fresh;
h[i] = let * tanhf(c[i]);
"""
