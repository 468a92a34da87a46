"""Extension points of `learn`: networks and optimisers.

Each maps names to modules and classes and imports them on first use, so that torch loads late.
"""

from __future__ import annotations

from typing import Any

from twin.registry import Registry

NETWORKS: Registry[Any] = Registry(
    "network",
    group="glider_twin.networks",
    folder="learn/networks",
    base="learn.Network",
    page="reference/networks.md#one-of-your-own",
    shipped={
        "ema": "learn.networks.fixed_memory:ExponentialAverages",
        "elman": "learn.networks.elman:Elman",
        "lstm": "learn.networks.gated:Lstm",
        "gru": "learn.networks.gated:Gru",
        "tcn": "learn.networks.tcn:CausalConvolutions",
        "mlp": "learn.networks.fixed_memory:Memoryless",
    },
    name="",
    words=("summary",),
    check_shipped=False,
)
"""Network types by name."""

OPTIMISERS: Registry[Any] = Registry(
    "optimiser",
    group="glider_twin.optimisers",
    folder="learn/training",
    base="learn.training.optimiser.Optimiser",
    page="reference/networks.md#one-of-your-own",
    shipped={
        "soap": "learn.training.minibatch:SoapOptimiser",
        "adam": "learn.training.minibatch:AdamOptimiser",
        "scg": "learn.training.scg:ScgOptimiser",
    },
    name="",
    words=("summary",),
    check_shipped=False,
)
"""Optimisers of the training by name."""
