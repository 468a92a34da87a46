"""Glider: the vehicle that is really out there, against the one that its guidance believes in."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.recipe.sampling import Parameters
from twin.mission import Mission
from twin.physics.mujoco_model import parameter_block
from twin.physics.native import block as b
from twin.physics.simulation import Simulation
from twin.vehicle.vehicle import Vehicle
from twin.water.density import DensityProfile

Array = NDArray[np.float64]

BALLAST_FRACTION = 0.5
"""A glider is ballasted neutral at this part of its deepest turning depth, as pilots do, so that
dive and climb share what the stratification costs."""
GRAM, MILLIMETRE = 1e-3, 1e-3
SHIFT_JOINT, ROTATION_JOINT = 7, 8  # places in qpos
ADDED_MASS_CELLS = {
    "surge": (0, 0), "sway": (1, 1), "heave": (2, 2), "roll": (3, 3), "pitch": (4, 4),
    "yaw": (5, 5), "sway_yaw": (1, 5), "heave_pitch": (2, 4),
}  # fmt: skip


@dataclasses.dataclass(frozen=True, kw_only=True)
class BelievedMission(Mission):
    """A mission whose guidance is trimmed for `believed`, whatever vehicle flies it."""

    believed: Vehicle
    """The vehicle as its file says."""

    def compile(self, vehicle: Vehicle) -> tuple[Array, Array]:
        """Table and gains for the believed vehicle; see `Mission.compile`."""
        return super().compile(self.believed)

    def plain(self) -> Mission:
        """The mission itself, for whichever vehicle."""
        return Mission(**{f.name: getattr(self, f.name) for f in dataclasses.fields(Mission)})

    def to_dict(self) -> dict[str, Any]:
        """The mission's own fields; see `Mission.to_dict`."""
        return self.plain().to_dict()


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
    actuators = ("shift", "rotation", "pump")
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
        actuator_lag=nominal.actuator_lag * [value(f"vehicle.{a}_lag") for a in actuators],
        actuator_rate=nominal.actuator_rate * [value(f"vehicle.{a}_rate") for a in actuators],
    )


def apply_errors(
    simulation: Simulation, parameters: Parameters, density: DensityProfile | None
) -> None:
    """Put the zero errors of the actuators and the ballasting into a compiled simulation.

    The joints' reference positions move: at an encoder's zero the battery then sits at the offset.
    Ballasting sets the displaced volume: neutral, but for the ballast error, where the glider was
    ballasted.
    """
    value = parameters.number
    reference = simulation.model.qpos0
    reference[SHIFT_JOINT] -= MILLIMETRE * value("vehicle.shift_offset_mm")
    reference[ROTATION_JOINT] -= math.radians(value("vehicle.rotation_offset_deg"))
    vehicle = simulation.scenario.vehicle
    heavy = GRAM * value("vehicle.ballast_g")
    if heavy or density is not None or vehicle.hull_compressibility:
        depth = BALLAST_FRACTION * parameters.deepest_m
        there = vehicle.reference_density if density is None else float(density.density(depth))
        pressure = vehicle.reference_density * vehicle.gravity * depth
        squeezed = 1.0 - vehicle.hull_compressibility * pressure
        block = parameter_block(simulation.model)
        block[b.P_NEUTRAL_VOLUME] = (vehicle.mass - heavy) / (there * squeezed)
