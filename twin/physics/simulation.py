"""Simulate: fly one mission or many, natively, and return their trajectories."""

from __future__ import annotations

import concurrent.futures
import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, SimulationUnstable
from twin.frames import euler_to_quaternion, flip_quaternion, flip_vector, quaternion_to_matrix
from twin.mission import Mission, guidance
from twin.mission.controller import Command, Controller, Observation
from twin.mission.schedule import Schedule
from twin.physics.mujoco_model import compile_model, parameter_block
from twin.physics.native import block as b
from twin.physics.outcome import collect
from twin.physics.quiet import quiet_mujoco
from twin.physics.scenario import Scenario, Start
from twin.records.trajectory import Trajectory

Array = NDArray[np.float64]

STEPS_PER_CALL = 20_000
"""Steps between looks at a run from Python: long enough to cost nothing, short enough to stop."""
MOST_SAMPLES = 4_000_000
"""Samples of one run: about 1.3 GB of log, 23 days at 2 Hz"""
IMPLICIT_STEP = 0.02
"""[s] longest step at which implicit and implicitfast carry the stiff servos"""
_EXPLICIT = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4)
END_CHECK_PERIOD = 30.0
"""[s] between looks whether a mission without a duration has been flown"""


class Simulation:
    """One scenario in MuJoCo: its model, its data and the tables that native code reads.

    `model` and `data` are ordinary MuJoCo objects; `mujoco.mj_step(model, data)` runs the water,
    the guidance and the log natively. Keep the Simulation alive as long as its model is stepped:
    the model's parameter block points into tables that it owns.
    """

    def __init__(self, scenario: Scenario, *, lean: bool = True):
        self.scenario = scenario
        vehicle = scenario.vehicle
        self.model = compile_model(
            vehicle,
            hydrodynamics=scenario.hydrodynamics,
            timestep=scenario.timestep,
            integrator=scenario.integrator,
            lean=lean,
        )
        self.duration = scenario.run_time()
        self._check_integration()
        self.rows = np.zeros((self._samples(), b.ROW))
        self._kept: list[Any] = []
        self.current_program: Array | None = None
        if scenario.current is not None:  # once: a gridded one reads its file
            self.current_program = scenario.current.compile(self.duration, scenario.origin)
        self._write_block()
        self.data = mujoco.MjData(self.model)
        self.reset()

    def _check_integration(self) -> None:
        """Refuse what cannot be flown: unsuitable integrators, uneven samples, too much memory."""
        step, period = self.model.opt.timestep, self.scenario.sample_period
        integrator = self.model.opt.integrator
        if integrator in _EXPLICIT:
            raise InputError(
                "the battery's lead screws are too stiff for integrator euler or rk4 at any useful "
                "step; use discrete (or implicitfast up to a step of "
                f"{IMPLICIT_STEP:g} s)"
            )
        if integrator != mujoco.mjtIntegrator.mjINT_DISCRETE and step > IMPLICIT_STEP:
            raise InputError(
                f"timestep {step:g} s is too long for the stiff servos under this integrator; use "
                f"at most {IMPLICIT_STEP:g} s, or integrator discrete"
            )
        steps = period / step
        if abs(steps - round(steps)) > 1e-6 or round(steps) < 1:
            nearest = max(1, round(steps)) * step
            raise InputError(
                f"sample period {period:g} s is not a whole number of steps of {step:g} s; the "
                f"nearest is {nearest:g} s"
            )
        if self._samples() < 2:
            raise InputError(
                f"a run of {self.duration:g} s holds fewer than two samples at a sample period of "
                f"{period:g} s; shorten the period"
            )
        if self._samples() > MOST_SAMPLES:
            raise InputError(
                f"a run of {self.duration:g} s at a sample period of {period:g} s makes "
                f"{self._samples():,} samples, more than {MOST_SAMPLES:,}; shorten the mission or "
                "lengthen the period"
            )

    def _samples(self) -> int:
        return math.floor(self.duration / self.scenario.sample_period + 1e-9) + 1

    @property
    def steps(self) -> int:
        """Steps of the whole run: the last sample is logged by the one before last, and the last
        one fills in its acceleration."""
        return math.ceil(self.duration / self.model.opt.timestep - 1e-9) + 2

    def _keep(self, values: Array) -> float:
        values = np.ascontiguousarray(values, float)
        self._kept.append(values)
        return float(values.ctypes.data)

    def _write_block(self) -> None:
        scenario, block = self.scenario, parameter_block(self.model)
        plan = scenario.plan
        if isinstance(plan, Mission):
            table, gains = plan.compile(scenario.vehicle)
            block[b.P_CONTROL] = b.CONTROL_MISSION
            block[b.P_GAINS : b.P_GAINS + len(gains)] = gains
            block[b.P_TABLE], block[b.P_TABLE_ROWS] = self._keep(table), len(table)
        elif isinstance(plan, Schedule):
            table = plan.table()
            block[b.P_CONTROL] = b.CONTROL_SCHEDULE
            block[b.P_CONTROL_PERIOD] = self.model.opt.timestep
            block[b.P_TABLE], block[b.P_TABLE_ROWS] = self._keep(table), len(table)
        if self.current_program is not None:
            program = self.current_program
            block[b.P_CURRENT], block[b.P_CURRENT_SIZE] = self._keep(program), len(program)
        if scenario.density is not None:
            program = scenario.density.compile()
            block[b.P_DENSITY], block[b.P_DENSITY_SIZE] = self._keep(program), len(program)
        # RK4 evaluates between steps and is centred by itself
        staged = self.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        block[b.P_CENTRED] = float(scenario.centred and not staged)
        block[b.P_LOG], block[b.P_LOG_ROWS] = float(self.rows.ctypes.data), len(self.rows)
        block[b.P_LOG_PERIOD] = scenario.sample_period

    def start(self) -> Start:
        """The scenario's start, or the mission's: at rest in the water at its depth and heading.

        What starts at the surface floats just immersed, as a neutral glider does: with
        its CB at depth 0 half of the hull would stand out of the water and drop.
        """
        if self.scenario.start is not None:
            return self.scenario.start
        plan, awash = self.scenario.plan, self.scenario.vehicle.hull_diameter / 2
        if isinstance(plan, Mission):
            heading = math.radians(plan.start_heading_deg)
            return Start(depth=max(plan.start_depth_m, awash), heading=heading)
        return Start(depth=awash)

    def reset(self) -> None:
        """Back to the start, with an empty log."""
        mujoco.mj_resetData(self.model, self.data)
        self.rows[:] = 0.0
        set_start(self.data, self.start(), self._current_at_start())
        if parameter_block(self.model)[b.P_CENTRED]:
            stagger(self.model, self.data)
            self.rows[:] = 0.0

    def _current_at_start(self) -> Array:
        program, start = self.current_program, self.start()
        if program is None:
            return np.zeros(3)
        from twin.water.current.sampler import sample

        return np.array(
            sample(program, 0.0, start.north, start.east, start.depth, 0.0, 0.0, 0.0)[:3]
        )

    def run(
        self, controller: Controller | None = None, *, mission: int | None = None
    ) -> Trajectory:
        """Fly the whole scenario.

        Args:
          controller: Python code that gives the commands each control period instead of a plan.
          mission: index that an error names beside the mission's name; None for a single run.

        Raises:
          SimulationUnstable: with the trajectory up to that time as `partial`.
        """
        if controller is not None:
            self._run_controlled(controller)
        else:
            remaining = self.steps
            per_call = STEPS_PER_CALL
            if self.scenario.open_ended:
                per_call = max(1, round(END_CHECK_PERIOD / self.model.opt.timestep))
            while remaining > 0 and not self.failed and not self.flown:
                count = min(remaining, per_call)
                mujoco.mj_step(self.model, self.data, nstep=count)
                remaining -= count
        return self.trajectory(mission)

    def _run_controlled(self, controller: Controller) -> None:
        vehicle, timestep = self.scenario.vehicle, self.model.opt.timestep
        per_tick = max(1, round(vehicle.control_period / timestep))
        done = 0
        while done < self.steps and not self.failed:
            command = controller(observe(self.model, self.data))
            if not isinstance(command, Command):
                raise InputError(f"the controller returned {command!r}; it must return a Command")
            self.data.ctrl[:] = command.as_array()
            count = min(per_tick, self.steps - done)
            mujoco.mj_step(self.model, self.data, nstep=count)
            done += count

    @property
    def flown(self) -> bool:
        """True when an open-ended mission has been flown to its end."""
        done = self.data.userdata[b.U_GUIDANCE + guidance.DONE]
        return self.scenario.open_ended and bool(done)

    @property
    def failed(self) -> bool:
        """True once the state has left the finite numbers."""
        return bool(self.data.userdata[b.U_FAILED])

    def trajectory(self, mission: int | None = None) -> Trajectory:
        """The samples so far.

        Raises:
          SimulationUnstable: the run went unstable; `partial` holds the finite samples.
        """
        return collect(self, self.data.userdata, mission)


def stagger(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Move the velocities half a step back in time, where a time-centred run keeps them.

    Evaluates the forward dynamics once and then clears `userdata`: guidance and log begin anew.
    """
    command = data.ctrl.copy()
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    # the battery is held by its screws: it moves with the hull
    change = np.linalg.solve(mass[:6, :6], data.qfrc_smooth[:6]) * model.opt.timestep
    data.qvel[:6] -= 0.5 * change
    data.ctrl[:], data.userdata[:] = command, 0.0
    data.userdata[b.U_TWIST : b.U_TWIST + 6] = data.qvel[:6]
    data.userdata[b.U_EARLIER : b.U_EARLIER + 6] = data.qvel[:6] - change
    data.userdata[b.U_TIME] = data.time
    data.userdata[b.U_KNOWN] = 1.0


def set_start(data: mujoco.MjData, start: Start, current: Array) -> None:
    """Write a start into MuJoCo's data; `current` NED [m/s] is the water's velocity there."""
    quaternion = euler_to_quaternion(start.roll, start.pitch, start.heading)
    velocity = quaternion_to_matrix(quaternion) @ np.array(start.v_rel) + current
    data.qpos[:3] = flip_vector([start.north, start.east, start.depth])
    data.qpos[3:7] = flip_quaternion(quaternion)
    data.qvel[:3] = flip_vector(velocity)
    data.qvel[3:6] = flip_vector(start.rates)
    data.act[:] = data.ctrl[:] = start.actuators
    data.qpos[7:9] = start.actuators[:2]


def observe(model: mujoco.MjModel, data: mujoco.MjData) -> Observation:
    """What a Python controller sees now: pose, rates and actuator positions, in NED and FRD."""
    from twin.frames import quaternion_to_euler

    roll, pitch, heading = quaternion_to_euler(flip_quaternion(data.qpos[3:7]))
    p, q, r = flip_vector(data.qvel[3:6])
    return Observation(
        time=float(data.time),
        depth=float(-data.qpos[2]),
        roll=float(roll),
        pitch=float(pitch),
        heading=float(heading),
        roll_rate=float(p),
        pitch_rate=float(q),
        yaw_rate=float(r),
        shift=float(data.act[0]),
        rotation=float(data.act[1]),
        pump=float(data.act[2]),
    )


def simulate(scenario: Scenario, controller: Controller | None = None) -> Trajectory:
    """Fly one scenario; see `Simulation.run`."""
    with quiet_mujoco():
        return Simulation(scenario).run(controller)


def simulate_many(
    scenarios: Sequence[Scenario], *, threads: int = 1
) -> list[Trajectory | SimulationUnstable]:
    """Fly scenarios side by side on `threads` threads; results do not depend on their number.

    Each element is the trajectory, or the `SimulationUnstable` that ended it.
    """

    def fly(item: tuple[int, Scenario]) -> Trajectory | SimulationUnstable:
        index, scenario = item
        simulation = Simulation(scenario)
        try:
            return simulation.run(mission=index)
        except SimulationUnstable as error:
            return error

    with quiet_mujoco():
        if threads <= 1:
            return [fly(item) for item in enumerate(scenarios)]
        with concurrent.futures.ThreadPoolExecutor(threads) as pool:
            return list(pool.map(fly, enumerate(scenarios)))
