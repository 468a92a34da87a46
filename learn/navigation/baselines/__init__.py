"""Baselines: what navigators do today, with one interface and the nominal vehicle only."""

from collections.abc import Mapping

from learn.navigation.baselines.base import Baseline, Estimate
from learn.navigation.baselines.dvl import Dvl
from learn.navigation.baselines.ekf import Ekf
from learn.navigation.baselines.onboard import Onboard
from learn.navigation.baselines.pitch_plus_alpha import PitchPlusAlpha
from learn.navigation.baselines.steady_flight import SteadyFlight

BASELINES: Mapping[str, type[Baseline]] = {
    "pitch_plus_alpha": PitchPlusAlpha,
    "steady_flight": SteadyFlight,
    "onboard": Onboard,
    "ekf": Ekf,
    "dvl": Dvl,
}
"""Every baseline by the name that tables use."""

__all__ = ["BASELINES", "Baseline", "Estimate"]
