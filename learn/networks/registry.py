"""Networks by name. No torch is imported before one is looked up."""

from __future__ import annotations

from typing import Any

from twin.seams import Registry

NETWORKS: Registry[Any] = Registry(
    "network",
    group="glider_twin.networks",
    shipped={
        "ema": "learn.networks.ema:ExponentialAverages",
        "elman": "learn.networks.elman:Elman",
        "lstm": "learn.networks.gated:Lstm",
        "gru": "learn.networks.gated:Gru",
        "tcn": "learn.networks.tcn:CausalConvolutions",
        "mlp": "learn.networks.mlp:Memoryless",
    },
    check="learn.networks.base:check_network",
    check_shipped=False,
)
"""Every kind of network, a subclass of `learn.networks.base.Network`."""
