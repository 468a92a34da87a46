"""Balance: the steady flight of a glider, forces in balance at every sample.

The flight model of glider pilots (Merckelbach et al. 2010), with the turn's forces added: weight
less buoyancy, the hydrodynamic force at (V, alpha, beta) and the reaction of the momentum to the
measured rates cancel. In flow axes, with T = W + P x omega turned by R_BC^T:

    D = (K_D0 + K_D alpha^2) V^2 = T_1,   SF = K_beta beta V^2 = -T_2,
    L = (K_L0 + K_alpha alpha) V^2 = T_3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.vehicle.vehicle import CUBIC_CM, Vehicle

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ITERATIONS = 30
"""of the fixed point, whose error shrinks by 2 K_D alpha / (K_alpha tan(path angle)) each, below
0.3 for paths steeper than 15 deg."""


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
    law = vehicle.flow_frame
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
        square = np.where(gliding, along, np.nan) / (
            vehicle.flow_frame.drag[0] + vehicle.flow_frame.drag[1] * alpha**2
        )
        limit = law.blend_angle
        with np.errstate(invalid="ignore"):
            slope = (normal / square - law.lift[0]) / law.lift[1]
            alpha = np.clip(np.nan_to_num(slope), -limit, limit)
            drift = -side / square / law.side_force[0]
            beta = np.clip(np.nan_to_num(drift), -limit, limit)
        speed = np.sqrt(np.nan_to_num(square))
    gliding = gliding & (np.abs(alpha) < limit) & (np.abs(beta) < limit)
    return speed, alpha, beta, gliding
