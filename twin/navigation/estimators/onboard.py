"""On-board: the track that the vehicle reckoned and logged by itself.

It is a track over ground: reset at every GPS fix, with the last depth-averaged current added (see
`twin.sensors.onboard`). Where a mission never had a fix, no current was known either, and the
track is one through the water, unless the vehicle is propelled: such vehicles reckon by their
Doppler log, which may see the bottom. It gives no velocity that could be set against surge and
sway.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn

import numpy as np

from twin.errors import InputError
from twin.navigation.dead_reckoning import Signals, finite_channel
from twin.navigation.estimators.base import Estimate, VelocityEstimator
from twin.vehicle.vehicle import Vehicle


class OnboardReckoning(VelocityEstimator):
    """The vehicle's own track, of whole missions alone."""

    kind = "onboard"
    title = "on-board track"
    summary = (
        "the track that the vehicle logged itself (w / tan(pitch + 3 deg), fixes, last dive's "
        "current; with a propeller by its Doppler log)"
    )
    colour = "purple"
    without_water = (
        "The on-board track is missing in them: it was reset at fixes or reckoned by a Doppler "
        "log, which puts the current into it."
    )
    channels = ("measured_onboard_north", "measured_onboard_east")

    @classmethod
    def open(cls, argument: str, vehicle: Vehicle, period: float) -> NoReturn:
        """Refuse: it has no velocity through the water.

        Raises:
          InputError: always; `pitch_plus_alpha` reckons in the same way.
        """
        raise InputError(
            "the on-board track is one over ground and gives no velocity through the water: choose "
            "pitch_plus_alpha, which reckons in the same way"
        )

    def step(self, sample: Mapping[str, float]) -> NoReturn:
        """Refuse as `open`."""
        self.open("", self.vehicle, self.period)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        track = np.stack([finite_channel(signals, name) for name in self.channels], axis=1)
        propelled = self.vehicle.steered("speed") is not None
        return Estimate(ground_track=track, uses_fixes=True, saw_bottom=propelled)
