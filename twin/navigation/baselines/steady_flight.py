"""Steady flight: forces in balance at every sample, with the nominal coefficients.

The balance itself is `twin.identify.balance`. Its angles follow from ratios of forces, so the
buoyancy hardly matters to them. The speed is the buoyancy's where the path is flat; where it is
steep the depth rate fixes it, which a wrong drag coefficient or ballast cannot spoil.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np

from twin.identify.balance import balance, net_mass
from twin.navigation.baselines.base import Baseline, Estimate, afloat, bridge, no_glider, smooth
from twin.navigation.dead_reckoning import Attitude, Signals, depth_rate, finite_channel
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class SteadyFlight(Baseline):
    """Speed, angle of attack and sideslip from forces in balance."""

    title = "steady flight model"
    summary = (
        "forces in balance at every sample with the nominal coefficients: angle of attack, "
        "sideslip and, where the path is flat, speed; where it is steep the depth "
        "rate gives the speed"
    )
    colour = "green"
    drawn = True
    channels: ClassVar[tuple[str, ...]] = (
        *("measured_depth", "measured_roll", "measured_pitch", "measured_heading"),
        *("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate", "measured_pump"),
    )

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """It needs a glider."""
        return no_glider(vehicle)

    def estimate(self, signals: Signals, period: float) -> Estimate:
        """See `twin.navigation.baselines.base.Baseline`."""
        depth = finite_channel(signals, "measured_depth")
        rate = smooth(depth_rate(depth, period), WINDOW_S, period)
        attitude = Attitude.of(signals)
        roll, pitch = (smooth(a, WINDOW_S, period) for a in (attitude.roll, attitude.pitch))
        steady = smooth(np.abs(attitude.pitch - pitch), WINDOW_S, period) < STEADY_PITCH
        rates = np.stack(
            [
                smooth(finite_channel(signals, f"measured_{name}_rate"), WINDOW_S, period)
                for name in ("roll", "pitch", "yaw")
            ]
        )
        net = net_mass(self.vehicle, finite_channel(signals, "measured_pump"), depth)
        speed, alpha, beta, gliding = balance(self.vehicle, net, roll, pitch, rates)
        direction = np.stack(
            [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)]
        )
        down = (
            -direction[0] * np.sin(pitch)
            + direction[1] * np.cos(pitch) * np.sin(roll)
            + direction[2] * np.cos(pitch) * np.cos(roll)
        )
        # At inflections nothing is in balance: there the velocities are bridged.
        gliding = gliding & steady & (rate * down > 0) & (np.abs(down) > LEAST_SINE)
        still = afloat(depth, period)
        gliding = gliding & ~still
        speed = (speed * FLAT_SINE**2 + rate * down) / (FLAT_SINE**2 + down**2)
        speed = np.maximum(speed, 0.0)
        surge, sway = (bridge(speed * direction[i], gliding, held=True) for i in (0, 1))
        return Estimate(surge=np.where(still, 0.0, surge), sway=np.where(still, 0.0, sway))
