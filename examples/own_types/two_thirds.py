"""Two thirds: a flight estimator slower than the vehicle's model."""

import dataclasses

from twin.identify import motion_of
from twin.logs.flight_estimator import FlightEstimator, register


@register
class TwoThirds(FlightEstimator):
    kind = "two-thirds"
    summary = "a vehicle that is slower than its model"

    def motion(self, store, log, calibration, start):
        found = motion_of(log, calibration, start=start)
        return dataclasses.replace(found, surge=found.surge * 2.0 / 3.0)
