"""Flight model: the three equations of translation, integrated (`twin.identify.translation`)."""

from __future__ import annotations

from twin.flight.estimators.base import FlightEstimator
from twin.identify.calibration import Calibration
from twin.identify.logged import Log
from twin.identify.speed import motion_of
from twin.identify.translation import Motion
from twin.records.reader import MissionStore


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
    ) -> Motion:
        """See `FlightEstimator.motion`."""
        return motion_of(log, calibration, start=start)
