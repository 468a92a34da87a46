"""Current: filter, smoother and forecast of the current that carries a glider.

tuned = tune(legs, latitude=31.5)
found = CurrentFilter(tuned.parameters, latitude=31.5)
"""

from twin.navigation.current.consistency import Consistency, Reaches, consistency_of
from twin.navigation.current.current_parameters import CALIBRATION as CALIBRATION
from twin.navigation.current.current_parameters import (
    CONSTITUENTS,
    CurrentParameters,
    chosen_constituents,
)
from twin.navigation.current.current_parameters import DIVE as DIVE
from twin.navigation.current.current_parameters import MODES as MODES
from twin.navigation.current.filter import CurrentFilter
from twin.navigation.current.leg import Leg, begin_leg, pass_leg, replay
from twin.navigation.current.modes import Innovation
from twin.navigation.current.modes import passage as passage
from twin.navigation.current.record import CurrentForecast
from twin.navigation.current.smoother import SmoothedTrack
from twin.navigation.current.tuning import Tuned, tune

__all__ = [
    "CONSTITUENTS",
    "Consistency",
    "CurrentFilter",
    "CurrentForecast",
    "CurrentParameters",
    "Innovation",
    "Leg",
    "Reaches",
    "SmoothedTrack",
    "Tuned",
    "begin_leg",
    "chosen_constituents",
    "consistency_of",
    "pass_leg",
    "replay",
    "tune",
]
