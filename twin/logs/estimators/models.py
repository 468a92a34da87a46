"""Steady model: forces in balance at every sample (`twin.identify.start_values`).

Flight model: the three equations of translation, integrated (`twin.identify.translation`).
"""

from __future__ import annotations

from twin.identify.calibration import Calibration
from twin.identify.logged import Log
from twin.identify.speed import motion_of
from twin.identify.translation import Translation
from twin.logs.estimators.base import FlightEstimator
from twin.records.reader import MissionStore


class SteadyModel(FlightEstimator):
    """The flight model of glider pilots, without inertia."""

    kind = "steady"
    summary = "forces in balance at every sample, zero at inflections"
    modelled = True

    def motion(
        self,
        store: MissionStore,
        log: Log,
        calibration: Calibration,
        start: tuple[float, float, float],
    ) -> Translation:
        """See `FlightEstimator.motion`; `start` plays no part in a balance."""
        return motion_of(log, calibration, "steady")


class FlightModel(FlightEstimator):
    """Weight, buoyancy, drag and lift with the vehicle's inertia."""

    kind = "flight"
    summary = "the vehicle's flight model with its inertia"
    modelled = True

    def motion(
        self,
        store: MissionStore,
        log: Log,
        calibration: Calibration,
        start: tuple[float, float, float],
    ) -> Translation:
        """See `FlightEstimator.motion`."""
        return motion_of(log, calibration, start=start)
