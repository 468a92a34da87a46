"""Baselines by name. Nothing heavy is imported before one is looked up."""

from __future__ import annotations

from typing import Any

from twin.seams import Registry

BASELINES: Registry[Any] = Registry(
    "baseline",
    group="glider_twin.baselines",
    shipped={
        "pitch_plus_alpha": "twin.navigation.estimators.pitch_plus_alpha:PitchPlusAlpha",
        "steady_flight": "twin.navigation.estimators.steady_flight:SteadyFlight",
        "onboard": "twin.navigation.estimators.onboard:OnboardReckoning",
        "ekf": "twin.navigation.estimators.ekf:Ekf",
        "dvl": "twin.navigation.estimators.dvl:Dvl",
    },
    check="twin.navigation.estimators.baseline:check_baseline",
    check_shipped=False,
)
"""Every baseline, a subclass of `twin.navigation.estimators.baseline.Baseline`, by name."""
