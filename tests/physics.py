"""Shared set-ups of the physics tests: a compiled glider in a given motion."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.frames import euler_to_quaternion, flip_quaternion, flip_vector
from twin.physics.model_block import header
from twin.physics.mujoco_model import compile_model
from twin.vehicle.vehicle import Vehicle, load_vehicle

DEEP = 1000.0


def glider(**options) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A compiled model and its data, deep under water."""
    model = compile_model(options.pop("vehicle", "glider"), lean=True, **options)
    data = mujoco.MjData(model)
    data.qpos[2] = -DEEP
    return model, data


def set_motion(data, *, roll=0.0, pitch=0.0, heading=0.0, velocity=(0, 0, 0), rates=(0, 0, 0)):
    """Attitude [rad], velocity NED [m/s], rates FRD [rad/s]."""
    data.qpos[3:7] = flip_quaternion(euler_to_quaternion(roll, pitch, heading))
    data.qvel[:3] = flip_vector(velocity)
    data.qvel[3:6] = flip_vector(rates)


def without_water_forces(vehicle: Vehicle | str = "glider") -> Vehicle:
    """The vehicle with added mass but without drag, lift and moments."""
    base = load_vehicle(vehicle) if isinstance(vehicle, str) else vehicle
    return base.replace(
        drag=(0.0, 0.0),
        lift=(0.0, 0.0),
        side_force=(0.0,),
        roll_moment=(0.0, 0.0),
        pitch_moment=(0.0, 0.0, 0.0),
        yaw_moment=(0.0, 0.0),
    )


def zero_servos(model: mujoco.MjModel) -> None:
    """Battery free on its rails: the actuators push with nothing."""
    model.actuator_gainprm[:] = 0.0
    model.actuator_biasprm[:] = 0.0


def full_mass(model, data) -> np.ndarray:
    """Joint-space mass matrix, shape (nv, nv)."""
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass


def added_mass_in_joint_space(model, data, added_mass: np.ndarray) -> np.ndarray:
    """J^T M_A J from its definition: J maps qvel to the FRD twist of the hull at the CB."""
    hull = model.body("hull").id
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, linear, angular, data.xpos[hull], hull)
    to_body = data.xmat[hull].reshape(3, 3).T
    flip = np.diag([1.0, -1.0, -1.0])
    jacobian = np.vstack([flip @ to_body @ linear, flip @ to_body @ angular])
    return jacobian.T @ added_mass @ jacobian


def hydrodynamic_wrench(model, data) -> np.ndarray:
    """Water's wrench at the CB in FRD without buoyancy (gravity in the header is zero)."""
    head = header(model)
    before = float(head["gravity"])
    head["gravity"] = 0.0
    mujoco.mj_forward(model, data)
    head["gravity"] = before
    hull = model.body("hull").id
    force, torque = data.xfrc_applied[hull, :3].copy(), data.xfrc_applied[hull, 3:].copy()
    torque += np.cross(data.xipos[hull] - data.xpos[hull], force)
    to_body = data.xmat[hull].reshape(3, 3).T
    return np.concatenate([flip_vector(to_body @ force), flip_vector(to_body @ torque)])
