"""Baselines: what navigators do today, with one interface and the nominal vehicle only."""

from collections.abc import Mapping

from learn.baselines.base import Baseline, Estimate
from learn.baselines.dvl import Dvl
from learn.baselines.ekf import Ekf
from learn.baselines.onboard import Onboard
from learn.baselines.pitch_plus_alpha import PitchPlusAlpha
from learn.baselines.steady_flight import SteadyFlight

BASELINES: Mapping[str, type[Baseline]] = {
    "pitch_plus_alpha": PitchPlusAlpha,
    "steady_flight": SteadyFlight,
    "onboard": Onboard,
    "ekf": Ekf,
    "dvl": Dvl,
}
"""Every baseline by the name that tables use."""

__all__ = ["BASELINES", "Baseline", "Estimate"]
