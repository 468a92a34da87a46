"""Learned flight: the hull's equation of motion, whose constants are learned on the way.

What `steady_flight` takes from the vehicle's file, the flight filter (`twin.navigation`) corrects
by each steady glide: drag, lift, ballast, compressibility and the accelerometers' pitch errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.navigation.dead_reckoning import Signals, finite_channel
from twin.navigation.estimators.base import (
    BodyVelocity,
    Estimate,
    State,
    VelocityDeviation,
    VelocityEstimator,
)
from twin.navigation.estimators.glide_deviation import glide_deviation
from twin.navigation.estimators.series import no_glider
from twin.navigation.flight_filter import FlightFilter
from twin.navigation.flight_filter_kernels import CHANNELS
from twin.vehicle.vehicle import Vehicle

SURGE, SWAY = 0, 1
"""Columns of the filter's outputs"""


class LearnedFlight(VelocityEstimator):
    """Surge and sway of a flight filter that begins with the nominal vehicle."""

    kind = "flight_filter"
    title = "flight filter"
    summary = (
        "the nominal vehicle's equation of motion, with the density that a CTD measures; what the "
        "depth rate of steady glides does not agree with corrects drag, lift, ballast, "
        "compressibility and the pitch on the way (`twin/navigation/flight_filter.py`)"
    )
    channels = (*CHANNELS, "measured_heading")

    def __init__(self, vehicle: Vehicle, period: float):
        """Begin before the first sample; see `VelocityEstimator`."""
        super().__init__(vehicle, period)
        self._filter = FlightFilter(vehicle, period)

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """It needs a glider."""
        return no_glider(vehicle)

    @property
    def deviation(self) -> VelocityDeviation:
        """See `VelocityEstimator`; that of a hull as in its file, which
        it comes to know better."""
        return glide_deviation(self.vehicle)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        given = {name: finite_channel(signals, name) for name in CHANNELS}
        found = FlightFilter(self.vehicle, self.period).run(given)
        return Estimate(
            surge=np.ascontiguousarray(found[:, SURGE]), sway=np.ascontiguousarray(found[:, SWAY])
        )

    def reset(self) -> None:
        """See `VelocityEstimator`."""
        self._filter.reset()

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`.

        Raises:
          InputError: a channel is missing or not finite.
        """
        found = self._filter.step(sample)
        return BodyVelocity(surge=float(found[SURGE]), sway=float(found[SWAY]))

    def state(self) -> dict[str, NDArray[Any]]:
        """See `VelocityEstimator`."""
        return self._filter.state()

    def restore(self, state: State) -> None:
        """See `VelocityEstimator`."""
        self._filter.restore(state)
