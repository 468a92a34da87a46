"""Baselines by name. Nothing heavy is imported before one is looked up."""

from __future__ import annotations

from typing import Any

from learn.registry import Registry

BASELINES: Registry[Any] = Registry(
    "baseline",
    "glider_twin.baselines",
    {
        "pitch_plus_alpha": "learn.navigation.baselines.pitch_plus_alpha:PitchPlusAlpha",
        "steady_flight": "learn.navigation.baselines.steady_flight:SteadyFlight",
        "onboard": "learn.navigation.baselines.onboard:Onboard",
        "ekf": "learn.navigation.baselines.ekf:Ekf",
        "dvl": "learn.navigation.baselines.dvl:Dvl",
    },
    check="learn.navigation.baselines.base:check_baseline",
)
"""Every baseline, a subclass of `learn.navigation.baselines.base.Baseline`, by the name that tables
use."""
