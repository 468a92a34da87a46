"""Vehicle errors: the drawn vehicle that flies, and the nominal one that its guidance assumes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from factory.recipe.sampling import Parameters
from twin.physics.ballast import Ballast
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

BALLAST_FRACTION = 0.5
"""A glider is ballasted neutral at this part of its deepest turning depth, as pilots do, so that
dive and climb share what the stratification costs."""
GRAM, MILLIMETRE = 1e-3, 1e-3
ADDED_MASS_CELLS = {
    "surge": (0, 0), "sway": (1, 1), "heave": (2, 2), "roll": (3, 3), "pitch": (4, 4),
    "yaw": (5, 5), "sway_yaw": (1, 5), "heave_pitch": (2, 4),
}  # fmt: skip


def spread_vehicle(nominal: Vehicle, parameters: Parameters) -> Vehicle:
    """`nominal` with the drawn coefficients, CG, compressibility and actuator dynamics."""
    value = parameters.number

    def scaled(coefficients: tuple[float, ...], *names: str) -> tuple[float, ...]:
        factors = [value(f"vehicle.{name}") for name in names]
        return tuple(c * f for c, f in zip(coefficients, factors, strict=True))

    added_mass = nominal.added_mass.copy()
    for name, (i, j) in ADDED_MASS_CELLS.items():
        added_mass[i, j] *= value(f"vehicle.added_mass_{name}")
        added_mass[j, i] = added_mass[i, j]
    cg = [0.0, MILLIMETRE * value("vehicle.cg_y_mm"), MILLIMETRE * value("vehicle.cg_z_mm")]
    return nominal.replace(
        drag=scaled(nominal.flow_frame.drag, "k_d0", "k_d"),
        lift=scaled(nominal.flow_frame.lift, "k_l0", "k_alpha"),
        side_force=scaled(nominal.flow_frame.side_force, "k_beta"),
        roll_moment=scaled(nominal.flow_frame.roll_moment, "k_mr", "k_p"),
        pitch_moment=scaled(nominal.flow_frame.pitch_moment, "k_m0", "k_m", "k_q"),
        yaw_moment=scaled(nominal.flow_frame.yaw_moment, "k_my", "k_r"),
        added_mass=added_mass,
        static_cg=nominal.static_cg + np.array(cg),
        hull_compressibility=nominal.hull_compressibility + value("vehicle.compressibility"),
        **{
            part.name: {
                "lag": part.lag * value(f"vehicle.{part.name}_lag"),
                "rate": part.rate * value(f"vehicle.{part.name}_rate"),
            }
            for part in nominal.parts
        },
    )


def ballast_of(parameters: Parameters) -> Ballast:
    """How the glider was weighed: neutral, but for the ballast error, where pilots do it."""
    return Ballast(
        depth=BALLAST_FRACTION * parameters.deepest_m,
        heavy=GRAM * parameters.number("vehicle.ballast_g"),
    )


def encoder_zeros(parameters: Parameters) -> dict[str, float]:
    """Where the parts are when their encoders say 0, in the parts' units."""
    return {
        "shift": MILLIMETRE * parameters.number("vehicle.shift_offset_mm"),
        "rotation": math.radians(parameters.number("vehicle.rotation_offset_deg")),
    }
