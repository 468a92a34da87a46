"""Velocity estimators by name, a seam: what on board says how fast the water goes by."""

from twin.navigation.estimator import BodyVelocity, VelocityEstimator
from twin.navigation.estimators.registry import (
    VELOCITY_ESTIMATORS,
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
