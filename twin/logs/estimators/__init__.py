"""Estimators: ways to the velocity through the water of a logged vehicle, a seam."""

from twin.logs.estimators.base import ESTIMATORS, FlightEstimator, open_estimator, register

__all__ = ["ESTIMATORS", "FlightEstimator", "open_estimator", "register"]
