"""Velocity estimators by name, a seam: what on board says how fast the water goes by.

Baselines are another: what navigators do today, with one interface and the nominal vehicle only.
Nothing is imported before it is used.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach

if TYPE_CHECKING:
    from twin.navigation.estimators.base import VELOCITY_ESTIMATORS as VELOCITY_ESTIMATORS
    from twin.navigation.estimators.base import BodyVelocity as BodyVelocity
    from twin.navigation.estimators.base import VelocityEstimator as VelocityEstimator
    from twin.navigation.estimators.base import open_velocity_estimator as open_velocity_estimator
    from twin.navigation.estimators.base import register as register
    from twin.navigation.estimators.base import usual_velocity_estimator as usual_velocity_estimator

_PLACES = {
    name: f"twin.navigation.estimators.base:{name}"
    for name in (
        "VELOCITY_ESTIMATORS",
        "BodyVelocity",
        "VelocityEstimator",
        "open_velocity_estimator",
        "register",
        "usual_velocity_estimator",
    )
}

__all__ = [*_PLACES]
__getattr__, __dir__ = attach(__name__, _PLACES)
