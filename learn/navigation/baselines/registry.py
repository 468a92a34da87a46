"""Baselines by name. Nothing heavy is imported before one is looked up."""

from __future__ import annotations

from typing import Any

from twin.registry import Registry

BASELINES: Registry[Any] = Registry(
    "baseline",
    group="glider_twin.baselines",
    shipped={
        "pitch_plus_alpha": "learn.navigation.baselines.pitch_plus_alpha:PitchPlusAlpha",
        "steady_flight": "learn.navigation.baselines.steady_flight:SteadyFlight",
        "onboard": "learn.navigation.baselines.onboard:Onboard",
        "ekf": "learn.navigation.baselines.ekf:Ekf",
        "dvl": "learn.navigation.baselines.dvl:Dvl",
    },
    check="learn.navigation.baselines.base:check_baseline",
    check_shipped=False,
)
"""Every baseline, a subclass of `learn.navigation.baselines.base.Baseline`, by the name that tables
use."""
