"""Baselines by name. Nothing heavy is imported before one is looked up."""

from __future__ import annotations

from typing import Any

from twin.registry import Registry

BASELINES: Registry[Any] = Registry(
    "baseline",
    group="glider_twin.baselines",
    shipped={
        "pitch_plus_alpha": "twin.navigation.baselines.pitch_plus_alpha:PitchPlusAlpha",
        "steady_flight": "twin.navigation.baselines.steady_flight:SteadyFlight",
        "onboard": "twin.navigation.baselines.onboard:Onboard",
        "ekf": "twin.navigation.baselines.ekf:Ekf",
        "dvl": "twin.navigation.baselines.dvl:Dvl",
    },
    check="twin.navigation.baselines.base:check_baseline",
    check_shipped=False,
)
"""Every baseline, a subclass of `twin.navigation.baselines.base.Baseline`, by the name that tables
use."""
