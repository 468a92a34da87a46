"""Settle: steady states of the MuJoCo twin, found by flying until the motion settles.

A trim found in this way is stable, because the vehicle reaches it by itself. A root
finder then removes the rest of the transient. The Fossen model finds its trims independently.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from twin.errors import NoSteadyState
from twin.frames import (
    euler_to_matrix,
    euler_to_quaternion,
    flip_quaternion,
    flip_vector,
    quaternion_to_euler,
    quaternion_to_matrix,
)
from twin.numbers import Array
from twin.physics.model_block import joint_places, state
from twin.physics.mujoco_model import compile_model, quiet_mujoco
from twin.vehicle.steady_motion import (
    Trim,
    advice,
    driven,
    positions_text,
    require_drive,
    solve_steady_state,
    trim_positions,
)
from twin.vehicle.vehicle import Vehicle

DEPTH = 1e4
"""[m] Depth of the run, far from the surface; the water has the reference density everywhere."""
SETTLED = 1e-4
"""Largest change of speed [m/s], rates [rad/s] and attitude [rad] over WINDOW once settled."""
WINDOW = 60.0
"""[s] Time between two comparisons of the motion."""
PATIENCE = 3600.0
"""[s] Time limit: a glider that is still unsteady after an hour has no usable steady state."""
START_SPEED, START_PITCH = 0.3, 0.5
"""Release, in the direction of buoyancy. START_SPEED: [m/s]. START_PITCH: [rad]."""
SAME_MOTION = 0.02
"""[m/s, rad, rad/s] Largest difference between the flown motion and the root of the equations."""


class LockedGlider:
    """Accelerations from MuJoCo of the vehicle with every part locked in its position."""

    def __init__(self, vehicle: Vehicle, hydrodynamics: str, positions: Array):
        self.model = compile_model(
            vehicle.replace(hull_compressibility=0.0), hydrodynamics=hydrodynamics, lean=True
        )
        # the glide is in open water: obstacles of the vehicle file are ignored
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self.data = mujoco.MjData(self.model)
        self.data.act[:] = self.data.ctrl[:] = positions
        self.data.qpos[2] = -DEPTH
        self._joints = [(place, positions[index]) for index, place in joint_places(self.model)]
        self._hold()
        self._mass = np.zeros((self.model.nv, self.model.nv))

    def _hold(self) -> None:
        """Put the moving masses where their parts are, without the servos' sag."""
        for place, position in self._joints:
            self.data.qpos[place] = position
        self.data.qvel[6:] = 0.0

    def residual(self, x: Array) -> Array:
        """Body-fixed accelerations, shape (6,), of (u, v, w, roll, pitch, turn rate)."""
        roll, pitch, turn = x[3:]
        to_ned = euler_to_matrix(roll, pitch, 0.0)
        rates = turn * to_ned[2]  # the vertical in body axes
        velocity = to_ned @ x[:3]
        data = self.data
        data.qpos[3:7] = flip_quaternion(euler_to_quaternion(roll, pitch, 0.0))
        data.qvel[:3], data.qvel[3:6] = flip_vector(velocity), flip_vector(rates)
        self._hold()
        mujoco.mj_forward(self.model, data)
        mujoco.mj_fullM(self.model, data, self._mass)
        force = data.qfrc_smooth[:6]
        acceleration = np.linalg.solve(self._mass[:6, :6], force)
        turning = np.array([-turn * velocity[1], turn * velocity[0], 0.0])
        linear = to_ned.T @ (flip_vector(acceleration[:3]) - turning)
        return np.concatenate([linear, flip_vector(acceleration[3:])])

    def net_mass(self) -> float:
        """Net mass [kg] at reference density, positive heavy, with its parts as held."""
        mujoco.mj_forward(self.model, self.data)
        return float(state(self.data)["net_mass"])

    def motion(self) -> Array:
        """Motion (u, v, w, roll, pitch, turn rate) of the current data."""
        quaternion = flip_quaternion(self.data.qpos[3:7])
        to_ned = quaternion_to_matrix(quaternion)
        roll, pitch, _ = quaternion_to_euler(quaternion)
        v_rel = to_ned.T @ flip_vector(self.data.qvel[:3])
        turn = (to_ned @ flip_vector(self.data.qvel[3:6]))[2]
        return np.array([*v_rel, roll, pitch, turn])


def trim(
    vehicle: Vehicle,
    shift: float = 0.0,
    rotation: float = 0.0,
    net_mass: float = 0.0,
    *,
    positions: Mapping[str, float] | None = None,
    hydrodynamics: str = "coefficients",
) -> Trim:
    """Steady motion that the vehicle reaches by itself at fixed positions of its parts.

    Args:
      shift: of the battery [m]. rotation: of the battery [rad]. net_mass: [kg], positive = heavy.
      positions: of parts by name, in their units; see `steady_motion.trim_positions`.

    Raises:
      InputError: positions outside the parts' travel. NoSteadyState: the motion does not settle.
    """
    wanted = trim_positions(vehicle, shift, rotation, net_mass, positions)
    glider = LockedGlider(vehicle, hydrodynamics, wanted)
    heavy = glider.net_mass()
    require_drive(vehicle, wanted, heavy)
    driving = driven(vehicle, wanted)
    with quiet_mujoco():
        settled = _fly_until_settled(glider, 0.0 if driving else math.copysign(1.0, heavy))
    request = positions_text(vehicle, wanted)
    ours = state(glider.data)
    if ours["failed"]:
        raise NoSteadyState(
            f"no steady state at {request}: the simulation went unstable at "
            f"{ours['fail_time']:.1f} s; check the vehicle's parameters, "
            "integrator and timestep"
        )
    if settled is None:
        last = glider.motion()
        raise NoSteadyState(
            f"no steady state at {request}: after {PATIENCE:.0f} s the vehicle moves unsteadily "
            f"(pitch {math.degrees(last[4]):.1f} deg, roll {math.degrees(last[3]):.1f} deg, speed "
            f"{np.linalg.norm(last[:3]):.2f} m/s); {advice(vehicle, wanted)}"
        )
    if settled[0] <= 0.0:
        raise NoSteadyState(
            f"no forward steady state at {request}: the vehicle goes tail first (angle of attack "
            f"{math.degrees(math.atan2(settled[2], settled[0])):.0f} deg), where the coefficients "
            f"say nothing; {advice(vehicle, wanted)}"
        )
    roots = solve_steady_state(glider.residual, [settled])
    if not roots or np.abs(roots[0] - settled).max() > SAME_MOTION:
        raise NoSteadyState(
            f"no steady state at {request}: the flown motion (pitch "
            f"{math.degrees(settled[4]):.1f} deg) is not a root of the equations of motion"
        )
    x = roots[0]
    return Trim.from_motion(
        v_rel=x[:3], roll=x[3], pitch=x[4], turn_rate=x[5], linear_angle=vehicle.law.valid_angle
    )


def _fly_until_settled(glider: LockedGlider, sinking: float) -> Array | None:
    """Release the glider and step it; return the settled motion, or None after PATIENCE."""
    model, data = glider.model, glider.data
    pitch = -sinking * START_PITCH
    velocity = euler_to_matrix(0.0, pitch, 0.0) @ np.array([START_SPEED, 0.0, 0.0])
    data.qpos[3:7] = flip_quaternion(euler_to_quaternion(0.0, pitch, 0.0))
    data.qvel[:3] = flip_vector(velocity)
    steps = round(WINDOW / model.opt.timestep)
    before = np.full(6, np.inf)
    while data.time < PATIENCE and not state(data)["failed"]:
        mujoco.mj_step(model, data, nstep=steps)
        now = glider.motion()
        if np.abs(now - before).max() < SETTLED:
            return now
        before = now
    return None
