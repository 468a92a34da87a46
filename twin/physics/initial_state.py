"""Initial state: a start and what a vehicle really is, written into MuJoCo's model and data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from twin.frames import euler_to_quaternion, flip_quaternion, flip_vector, quaternion_to_matrix
from twin.numbers import Array
from twin.physics.model_block import header, joint_places, part_names, part_table, state
from twin.physics.start import Start
from twin.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from twin.physics.ballast import Ballast
    from twin.water.density import DensityProfile


def stagger(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Move the velocities half a step back in time, where a time-centred run keeps them.

    Evaluates the forward dynamics once and then clears `userdata`: guidance and log begin again.
    """
    command = data.ctrl.copy()
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    # the battery is held by its screws: it moves with the hull
    change = np.linalg.solve(mass[:6, :6], data.qfrc_smooth[:6]) * model.opt.timestep
    data.qvel[:6] -= 0.5 * change
    data.ctrl[:], data.userdata[:] = command, 0.0
    ours = state(data)
    ours["twist"], ours["earlier"] = data.qvel[:6], data.qvel[:6] - change
    ours["time"], ours["known"] = data.time, 1.0


def set_start(model: mujoco.MjModel, data: mujoco.MjData, start: Start, current: Array) -> None:
    """Write a start into MuJoCo's data; `current` NED [m/s] is the water's velocity there."""
    quaternion = euler_to_quaternion(start.roll, start.pitch, start.heading)
    velocity = quaternion_to_matrix(quaternion) @ np.array(start.v_rel) + current
    data.qpos[:3] = flip_vector([start.north, start.east, start.depth])
    data.qpos[3:7] = flip_quaternion(quaternion)
    data.qvel[:3] = flip_vector(velocity)
    data.qvel[3:6] = flip_vector(start.rates)
    positions = start.positions(part_names(model), part_table(model)["rest"])
    data.act[:] = data.ctrl[:] = positions
    for index, place in joint_places(model):
        data.qpos[place] = positions[index]


def apply_real_vehicle(
    model: mujoco.MjModel,
    vehicle: Vehicle,
    *,
    ballast: Ballast | None,
    density: DensityProfile | None,
    encoder_zeros: Mapping[str, float],
) -> None:
    """Put the ballasting and the encoders' zero errors of a vehicle into its model.

    Args:
      density: of the water that it was weighed for. encoder_zeros: by part, in the parts' units.
    """
    head, rows = header(model), part_table(model)
    if ballast is not None:
        head["neutral_volume"] = ballast.neutral_volume(vehicle, density)
    driven = dict(joint_places(model))
    for name, zero in encoder_zeros.items():
        index = vehicle.part_names.index(name)
        if index in driven:
            # at the encoder's zero the joint then sits at the offset
            model.qpos0[driven[index]] -= zero
        else:
            rows[index]["zero"] = zero
