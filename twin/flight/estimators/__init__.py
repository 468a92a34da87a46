"""Estimators: ways to the velocity through the water of a logged vehicle, a seam."""

from twin.flight.estimators.base import FlightEstimator
from twin.flight.estimators.registry import ESTIMATORS, open_estimator, register

__all__ = ["ESTIMATORS", "FlightEstimator", "open_estimator", "register"]
