"""Steady flight: forces in balance at every sample, with the nominal coefficients.

The balance itself is `twin.identify.start_values`. Its angles follow from ratios of forces, so the
buoyancy hardly matters to them. The speed is the buoyancy's where the path is flat; where it is
steep the depth rate fixes it, which a wrong drag coefficient or ballast cannot spoil.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from twin.identify.start_values import balance, net_mass
from twin.navigation.dead_reckoning import (
    Array,
    AttitudeSeries,
    Signals,
    depth_rate,
    finite_channel,
)
from twin.navigation.estimators.base import BodyVelocity, Estimate, VelocityDeviation
from twin.navigation.estimators.glide_deviation import glide_deviation
from twin.navigation.estimators.series import Mask, afloat, bridge, no_glider, smooth
from twin.navigation.estimators.windowed import WindowedEstimator
from twin.vehicle.vehicle import Vehicle

WINDOW_S = 10.0
"""[s] average of every measured input: shorter than a glider takes to settle, longer than noise."""
STEADY_PITCH = np.deg2rad(2.0)
"""[rad] by which pitch may differ from its average: more, and the vehicle is turning over."""
FLAT_SINE = 0.07
"""Sine of the path angle (4 deg) at which the buoyancy's and the depth rate's speed count alike."""
LEAST_SINE = 0.12
"""Sine of the path angle (7 deg) below which there is no steady glide: the best glide ratio of
buoyancy gliders is near 8."""


class SteadyFlight(WindowedEstimator):
    """Speed, angle of attack and sideslip from forces in balance."""

    kind = "steady_flight"
    title = "steady flight model"
    summary = (
        "forces in balance at every sample with the nominal coefficients: angle of attack, "
        "sideslip and, where the path is flat, speed; where it is steep the depth "
        "rate gives the speed"
    )
    colour = "green"
    drawn = True
    channels = (
        *("measured_depth", "measured_roll", "measured_pitch", "measured_heading"),
        *("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate", "measured_pump"),
    )

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """It needs a glider."""
        return no_glider(vehicle)

    @property
    def deviation(self) -> VelocityDeviation:
        """See `VelocityEstimator`."""
        return glide_deviation(self.vehicle)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        seen = Seen.of(self.vehicle, signals, self.period)
        velocity, gliding = seen.balanced(self.vehicle, slice(None))
        surge, sway = (bridge(one, gliding, held=True) for one in velocity)
        return Estimate(
            surge=np.where(seen.still, 0.0, surge), sway=np.where(seen.still, 0.0, sway)
        )

    def last(self, signals: Signals) -> BodyVelocity:
        """See `WindowedEstimator`; only samples from the last glide on are balanced."""
        seen = Seen.of(self.vehicle, signals, self.period)
        end, count = (0 if seen.still[-1] else len(seen.still)), 1
        while end > 0:
            begin = max(end - count, 0)
            velocity, gliding = seen.balanced(self.vehicle, slice(begin, end))
            if gliding.any():
                surge, sway = velocity[:, np.flatnonzero(gliding)[-1]]
                return BodyVelocity(surge=float(surge), sway=float(sway))
            end, count = begin, 2 * count
        return BodyVelocity(surge=0.0, sway=0.0)


@dataclasses.dataclass(frozen=True)
class Seen:
    """What was measured, averaged; angles and rates in radians."""

    rate: Array
    """[m/s] of depth, (time,)"""
    roll: Array
    pitch: Array
    rates: Array
    """[rad/s], (3, time)"""
    net: Array
    """[kg] net buoyancy mass, (time,)"""
    steady: Mask
    """Whether the pitch rests, under water"""
    still: Mask
    """Whether it lies at the surface"""

    @classmethod
    def of(cls, vehicle: Vehicle, signals: Signals, period: float) -> Seen:
        """Of one mission, or of its last minutes."""
        depth = finite_channel(signals, "measured_depth")
        attitude = AttitudeSeries.of(signals)
        turning = [finite_channel(signals, f"measured_{n}_rate") for n in ("roll", "pitch", "yaw")]
        rows = np.stack([depth_rate(depth, period), attitude.roll, attitude.pitch, *turning])
        rate, roll, pitch, *rates = smooth(rows, WINDOW_S, period)
        swing = smooth(np.abs(attitude.pitch - pitch), WINDOW_S, period)
        still = afloat(depth, period)
        return cls(
            rate=rate,
            roll=roll,
            pitch=pitch,
            rates=np.stack(rates),
            net=net_mass(vehicle, finite_channel(signals, "measured_pump"), depth),
            steady=(swing < STEADY_PITCH) & ~still,
            still=still,
        )

    def balanced(self, vehicle: Vehicle, span: slice) -> tuple[Array, Mask]:
        """Surge and sway [m/s] of some samples, (2, samples), and where forces are in balance.

        At inflections nothing is.
        """
        rate, roll, pitch = self.rate[span], self.roll[span], self.pitch[span]
        speed, alpha, beta, gliding = balance(
            vehicle, self.net[span], roll, pitch, self.rates[:, span]
        )
        direction = np.stack(
            [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)]
        )
        down = (
            -direction[0] * np.sin(pitch)
            + direction[1] * np.cos(pitch) * np.sin(roll)
            + direction[2] * np.cos(pitch) * np.cos(roll)
        )
        gliding = gliding & self.steady[span] & (rate * down > 0) & (np.abs(down) > LEAST_SINE)
        speed = (speed * FLAT_SINE**2 + rate * down) / (FLAT_SINE**2 + down**2)
        return np.maximum(speed, 0.0) * direction[:2], gliding
