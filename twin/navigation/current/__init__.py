"""Current: filter, smoother and forecast of the current that carries a glider.

tuned = tune(legs, latitude=31.5)
found = CurrentFilter(tuned.parameters, latitude=31.5)
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.navigation.current.current_parameters import CALIBRATION as CALIBRATION
    from twin.navigation.current.current_parameters import CONSTITUENTS as CONSTITUENTS
    from twin.navigation.current.current_parameters import DIVE as DIVE
    from twin.navigation.current.current_parameters import MODES as MODES
    from twin.navigation.current.current_parameters import CurrentParameters as CurrentParameters
    from twin.navigation.current.current_parameters import (
        chosen_constituents as chosen_constituents,
    )
    from twin.navigation.current.filter import CurrentFilter as CurrentFilter
    from twin.navigation.current.modes import CurrentForecast as CurrentForecast
    from twin.navigation.current.modes import Innovation as Innovation
    from twin.navigation.current.modes import SmoothedTrack as SmoothedTrack
    from twin.navigation.current.modes import passage as passage
    from twin.navigation.current.tuning import Consistency as Consistency
    from twin.navigation.current.tuning import Leg as Leg
    from twin.navigation.current.tuning import Reaches as Reaches
    from twin.navigation.current.tuning import Tuned as Tuned
    from twin.navigation.current.tuning import begin_leg as begin_leg
    from twin.navigation.current.tuning import consistency_of as consistency_of
    from twin.navigation.current.tuning import pass_leg as pass_leg
    from twin.navigation.current.tuning import replay as replay
    from twin.navigation.current.tuning import tune as tune

__getattr__, __dir__ = attach(__name__, places(__name__))
