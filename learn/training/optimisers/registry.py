"""Optimisers by name. No torch is imported before one is looked up."""

from __future__ import annotations

from typing import Any

from twin.seams import Registry

OPTIMISERS: Registry[Any] = Registry(
    "optimiser",
    group="glider_twin.optimisers",
    shipped={
        "soap": "learn.training.optimisers.soap:SoapOptimiser",
        "adam": "learn.training.optimisers.adam:AdamOptimiser",
        "scg": "learn.training.optimisers.scg:ScgOptimiser",
    },
    check="learn.training.optimisers.base:check_optimiser",
    check_shipped=False,
)
"""Every optimiser, a subclass of one of those of `learn.training.optimisers.base`."""
