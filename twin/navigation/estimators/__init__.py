"""Velocity estimators by name, a seam: what on board says how fast the water goes by.

Baselines: what navigators do today, with one interface and the nominal vehicle only.
"""

from twin.navigation.estimators.base import (
    VELOCITY_ESTIMATORS,
    BodyVelocity,
    VelocityEstimator,
    open_velocity_estimator,
    register,
    usual_velocity_estimator,
)

__all__ = [
    "VELOCITY_ESTIMATORS",
    "BodyVelocity",
    "VelocityEstimator",
    "open_velocity_estimator",
    "register",
    "usual_velocity_estimator",
]
