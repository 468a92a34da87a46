"""Steady model: forces in balance at every sample (`twin.identify.balance`)."""

from __future__ import annotations

from twin.flight.estimators.base import FlightEstimator
from twin.identify.calibration import Calibration
from twin.identify.logged import Log
from twin.identify.speed import motion_of
from twin.identify.translation import Motion
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
    ) -> Motion:
        """See `FlightEstimator.motion`; `start` plays no part in a balance."""
        return motion_of(log, calibration, "steady")
