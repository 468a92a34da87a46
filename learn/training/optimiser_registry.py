"""Optimisers by name. No torch is imported before one is looked up."""

from __future__ import annotations

from typing import Any

from twin.seams import Registry

OPTIMISERS: Registry[Any] = Registry(
    "optimiser",
    group="glider_twin.optimisers",
    shipped={
        "soap": "learn.training.soap:SoapOptimiser",
        "adam": "learn.training.adam:AdamOptimiser",
        "scg": "learn.training.scg:ScgOptimiser",
    },
    check="learn.training.optimiser:check_optimiser",
    check_shipped=False,
)
"""Every optimiser, a subclass of one of those of `learn.training.optimiser`."""
