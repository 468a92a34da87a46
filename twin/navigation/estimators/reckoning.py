"""Reckoning on board: speed from the depth rate along an assumed path, and the vehicle's own track.

A glider's path is steeper than its pitch by the angle of attack a, so that its speed through the
water is |z'| / sin(|pitch| + a) and its horizontal speed |z'| / tan(|pitch| + a), along the
measured heading. Slocum gliders navigate so, Spray with a = 3 deg (OceanGliders, depth-averaged
current procedure). Sway is taken as zero.

The logged track is one over ground: reset at every GPS fix, with the last depth-averaged current
added (see `twin.sensors.onboard`). In a mission that never had a fix it is one through the water,
unless the vehicle is propelled: such vehicles reckon by their Doppler log, which may see the
bottom. It gives no velocity that could be set against surge and sway.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import NoReturn

import numpy as np

from twin.errors import InputError
from twin.navigation.dead_reckoning import (
    Signals,
    afloat,
    depth_rate,
    finite_channel,
    hold,
    no_glider,
    smooth,
)
from twin.navigation.estimators.base import Estimate, VelocityEstimator, WindowedEstimator
from twin.vehicle.vehicle import Vehicle

REFERENCE_PITCH = math.radians(26.0)
"""[rad] magnitude of the pitch that the constant is taken at, the usual one of gliders (Slocum)."""
WINDOW_S = 20.0
"""[s] average of depth rate and pitch; the vehicle's own software uses it too."""
LEAST_PITCH = math.radians(10.0)
"""[rad] below this the quotient is not used and the last speed is held (inflections)."""
MAX_SPEED = 1.0
"""[m/s] no buoyancy glider is faster through the water for long."""


class PitchPlusAlpha(WindowedEstimator):
    """Speed from depth rate, pitch and one constant angle of attack."""

    kind = "pitch_plus_alpha"
    title = "w / tan(pitch + alpha)"
    summary = (
        "speed from depth rate over sin(pitch + a), along the heading, with one constant a: that "
        "of the nominal vehicle at 26 deg of pitch"
    )
    colour = "orange"
    drawn = True
    channels = ("measured_depth", "measured_pitch")

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """It needs a glider."""
        return no_glider(vehicle)

    @functools.cached_property
    def angle_of_attack(self) -> float:
        """The constant [rad]: the nominal vehicle's in a steady glide at `REFERENCE_PITCH`."""
        return steady_angle_of_attack(self.vehicle, REFERENCE_PITCH)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        depth = finite_channel(signals, "measured_depth")
        pitch = np.deg2rad(finite_channel(signals, "measured_pitch"))
        rate = smooth(depth_rate(depth, self.period), WINDOW_S, self.period)
        slope = smooth(pitch, WINDOW_S, self.period)
        gliding = (np.abs(slope) >= LEAST_PITCH) & (rate * slope < 0)
        alpha = self.angle_of_attack
        speed = np.abs(rate) / np.sin(np.maximum(np.abs(slope), LEAST_PITCH) + alpha)
        speed = hold(np.minimum(speed, MAX_SPEED), gliding)
        speed = np.where(afloat(depth, self.period), 0.0, speed)
        return Estimate(surge=speed * math.cos(alpha), sway=np.zeros_like(speed))


def steady_angle_of_attack(vehicle: Vehicle, pitch: float) -> float:
    """Angle of attack [rad] of a wings-level glide at |pitch| [rad], from the coefficients.

    Mean of dive and climb, whose lift at zero angle differs in sign. Drag over lift is the tangent
    of the path's angle (Graver 2005, section 4.1): (K_D0 + K_D a^2) = (K_L0 + K_alpha a) tan.
    """
    law, angles = vehicle.flow_frame, []
    for sign in (1.0, -1.0):
        alpha = 0.0
        for _ in range(100):
            drag = law.polar(alpha, vehicle.reference_density).drag
            alpha = (drag / math.tan(pitch + alpha) - sign * law.lift[0]) / law.lift[1]
        angles.append(alpha)
    return sum(angles) / 2


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
