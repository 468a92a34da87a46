"""Shared set-ups of the physics tests: a compiled glider in a given motion, both models."""

import itertools

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from twin.fossen import FossenModel, FossenState, FossenTrajectory
from twin.fossen.equations import QUATERNION, actuators_after, derivative
from twin.frames import euler_to_quaternion, flip_quaternion, flip_vector
from twin.mission.controller import Schedule
from twin.physics.model_block import header
from twin.physics.mujoco_model import compile_model
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.records.trajectory import Trajectory
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


def held(vehicle: Vehicle | str, command, duration: float, **options) -> Scenario:
    """A scenario of `duration` [s] in which one command is held."""
    plan = Schedule(times=[0.0], commands=[command])
    return Scenario(vehicle=vehicle, mission=plan, duration=duration, **options)


def fossen_state(start: Start) -> FossenState:
    """A start for the Fossen model."""
    return FossenState(
        position_ned=(start.north, start.east, start.depth),
        attitude=(start.roll, start.pitch, start.heading),
        v_rel=start.v_rel,
        rates=start.rates,
        actuators=start.actuators,
    )


def reference(model: FossenModel, *arguments, **options) -> FossenTrajectory:
    """`FossenModel.simulate` by scipy's DOP853 at a tolerance of 1e-11, to judge others by."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twin.fossen.model.integrate", _dop853)
        return model.simulate(*arguments, **options)


def _dop853(p, program, law, y0, actuators0, breakpoints, commands, dt):
    """In place of `twin.fossen.equations.integrate`, restarted wherever a command changes."""
    states = np.empty((breakpoints.size, y0.size))
    positions = np.empty((breakpoints.size, actuators0.size))
    states[0], positions[0] = y0, actuators0
    changes = np.flatnonzero(np.any(np.diff(commands, axis=0) != 0.0, axis=1)) + 1
    for first, last in itertools.pairwise([0, *changes.tolist(), breakpoints.size - 1]):
        begin, command, held = breakpoints[first], commands[first], positions[first]

        def rate(t, y, begin=begin, command=command, held=held):
            return derivative(p, program, t, y, actuators_after(held, command, law, t - begin))

        span = breakpoints[first : last + 1]
        found = solve_ivp(
            rate, (span[0], span[-1]), states[first], method="DOP853", t_eval=span, rtol=1e-11,
            atol=1e-11, max_step=20.0 * dt,
        )  # fmt: skip
        assert found.success
        states[first : last + 1] = found.y.T
        norm = np.linalg.norm(states[first : last + 1, QUATERNION], axis=1, keepdims=True)
        states[first : last + 1, QUATERNION] /= norm
        for row in range(first, last + 1):
            positions[row] = actuators_after(held, command, law, breakpoints[row] - begin)
    return states, positions, breakpoints.size


def fly_both(
    vehicle: Vehicle, start: Start, command, duration: float, *, current=None, **options
) -> tuple[Trajectory, FossenTrajectory]:
    """One command held for `duration` [s] by the twin and by the Fossen model."""
    options = {"timestep": 0.1, **options}
    scenario = held(vehicle, command, duration, start=start, current=current, **options)
    program = None if current is None else current.compile(duration)
    theirs = FossenModel(vehicle, current_program=program).simulate(
        fossen_state(start), scenario.mission, duration, sample_period=scenario.sample_period
    )
    return simulate(scenario), theirs


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
