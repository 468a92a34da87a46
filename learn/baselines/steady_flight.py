"""Steady flight: forces in balance at every sample, with the nominal coefficients.

The flight model of glider pilots (Merckelbach et al. 2010), with the turn's forces added: weight
less buoyancy, the hydrodynamic force at (V, alpha, beta) and the reaction of the momentum to the
measured rates cancel. In flow axes, with T = W + P x omega turned by R_BC^T:

    D = (K_D0 + K_D alpha^2) V^2 = T_1,   SF = K_beta beta V^2 = -T_2,
    L = (K_L0 + K_alpha alpha) V^2 = T_3.

The angles follow from the ratios of these, so the buoyancy hardly matters to them. The speed is
the buoyancy's where the path is flat; where it is steep the depth rate fixes it, which a wrong
drag coefficient or ballast cannot spoil.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np

from learn.baselines.base import Baseline, Estimate, Mask, afloat, bridge, smooth
from learn.dead_reckoning import Array, Attitude, Signals, depth_rate, finite_channel
from twin.vehicle import CUBIC_CM, Vehicle

WINDOW_S = 10.0
"""[s] average of every measured input: shorter than a glider takes to settle, longer than noise."""
STEADY_PITCH = np.deg2rad(2.0)
"""[rad] by which pitch may differ from its average: more, and the vehicle is turning over."""
ITERATIONS = 30
"""of the fixed point, whose error shrinks by 2 K_D alpha / (K_alpha tan(path angle)) each, below
0.3 for paths steeper than 15 deg."""
FLAT_SINE = 0.07
"""Sine of the path angle (4 deg) at which the buoyancy's and the depth rate's speed count alike."""
LEAST_SINE = 0.12
"""Sine of the path angle (7 deg) below which there is no steady glide: the best glide ratio of
buoyancy gliders is near 8."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SteadyFlight(Baseline):
    """Speed, angle of attack and sideslip from forces in balance."""

    channels: ClassVar[tuple[str, ...]] = (
        *("measured_depth", "measured_roll", "measured_pitch", "measured_heading"),
        *("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate", "measured_pump"),
    )

    def estimate(self, signals: Signals, period: float) -> Estimate:
        """See `learn.baselines.base.Baseline`."""
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
        surge, sway = (bridge(speed * direction[i], gliding) for i in (0, 1))
        return Estimate(surge=np.where(still, 0.0, surge), sway=np.where(still, 0.0, sway))


def net_mass(vehicle: Vehicle, pump: Array, depth: Array) -> Array:
    """Net buoyancy mass [kg], + = heavy, that the nominal vehicle has; pump in cm3, depth in m."""
    pressure = vehicle.reference_density * vehicle.gravity * depth
    volume = (vehicle.neutral_volume + CUBIC_CM * pump) * (
        1.0 - vehicle.hull_compressibility * pressure
    )
    return vehicle.mass - vehicle.reference_density * volume


def balance(
    vehicle: Vehicle, net: Array, roll: Array, pitch: Array, rates: Array
) -> tuple[Array, Array, Array, Mask]:
    """The steady motion at each sample.

    Args:
      net: net buoyancy mass [kg], (time,).
      roll, pitch: [rad], (time,).
      rates: roll, pitch and yaw rate [rad/s], body FRD, (3, time).

    Returns:
      Speed [m/s], angle of attack and sideslip [rad], and where there is such a motion (bool):
      elsewhere the weight does not pull along the hull, as at an inflection. Each (time,).
    """
    weight = (
        vehicle.gravity
        * net
        * np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    )
    inertia = vehicle.mass * np.eye(3) + vehicle.added_mass[:3, :3]
    alpha, beta = np.zeros_like(pitch), np.zeros_like(pitch)
    speed = np.zeros_like(pitch)
    gliding: Mask = np.ones(pitch.shape, bool)
    for _ in range(ITERATIONS):
        c_a, s_a, c_b, s_b = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
        momentum = inertia @ (speed * np.stack([c_a * c_b, s_b, s_a * c_b]))
        total = weight + np.cross(momentum, rates, axis=0)
        # Rows of R_BC^T (Zhang et al. 2013).
        along = c_a * c_b * total[0] + s_b * total[1] + s_a * c_b * total[2]
        side = -c_a * s_b * total[0] + c_b * total[1] - s_a * s_b * total[2]
        normal = -s_a * total[0] + c_a * total[2]
        gliding = along > 0
        square = np.where(gliding, along, np.nan) / (vehicle.drag[0] + vehicle.drag[1] * alpha**2)
        limit = vehicle.blend_angle
        with np.errstate(invalid="ignore"):
            slope = (normal / square - vehicle.lift[0]) / vehicle.lift[1]
            alpha = np.clip(np.nan_to_num(slope), -limit, limit)
            drift = -side / square / vehicle.side_force[0]
            beta = np.clip(np.nan_to_num(drift), -limit, limit)
        speed = np.sqrt(np.nan_to_num(square))
    gliding = gliding & (np.abs(alpha) < limit) & (np.abs(beta) < limit)
    return speed, alpha, beta, gliding
