"""Velocity estimators by name: a vehicle's velocity through the water.

Baselines are the methods that navigators use today, with the nominal vehicle only. Users add their
own estimators by name. An estimator is imported when it is used.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.navigation.estimators.base import VELOCITY_ESTIMATORS as VELOCITY_ESTIMATORS
    from twin.navigation.estimators.base import BodyVelocity as BodyVelocity
    from twin.navigation.estimators.base import Estimate as Estimate
    from twin.navigation.estimators.base import VelocityEstimator as VelocityEstimator
    from twin.navigation.estimators.base import WindowedEstimator as WindowedEstimator
    from twin.navigation.estimators.base import baselines as baselines
    from twin.navigation.estimators.base import open_velocity_estimator as open_velocity_estimator
    from twin.navigation.estimators.base import register as register
    from twin.navigation.estimators.base import usual_velocity_estimator as usual_velocity_estimator

_PLACES = places(__name__)
__all__ = [*_PLACES]
__getattr__, __dir__ = attach(__name__, _PLACES)
