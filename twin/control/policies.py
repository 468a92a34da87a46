"""Policies: pilots by name, to compare with and to watch.

They read the physics instead of the observation, so they know the true state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from twin.control.physics import Physics
from twin.control.task import GliderTask, Reference, wrap_angle
from twin.errors import MissionError
from twin.frames import euler_to_matrix
from twin.mission.mission_file import GAINS
from twin.mission.stationing import share_wrench, thruster_gains
from twin.mission.turning import turn_factor
from twin.mission.way import way
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle

Policy = Callable[[Any], Array]


class Flown(Protocol):
    """Interface of the environments, of any type, that a policy can fly."""

    @property
    def task(self) -> GliderTask:
        """Task of the environment."""

    @property
    def physics(self) -> Physics:
        """Physics of the vehicle."""


LARGEST_ROTATION = math.radians(60.0)
"""[rad] Limit of the turning part; beyond it a climbing glider can roll over."""


class Autopilot:
    """Policy that flies the task's reference with the vehicle's own gains."""

    damping = 1.0
    """[1] Fraction of the file's rate gains that is used."""

    def __init__(self, environment: Flown):
        self._environment = environment
        self._trims: dict[tuple[float, float], tuple[Array, float]] = {}
        self._integral, self._before = np.zeros(4), math.inf

    def __call__(self, time_step: Any = None) -> Array:
        """Return the action now; dm_control's viewer passes the time step, which is not used."""
        task, physics = self._environment.task, self._environment.physics
        vehicle = task.vehicle
        wanted = task.reference(physics)
        command = vehicle.rest
        if wanted.position is not None:
            self._hold_pose(wanted, command)
            return task.to_action(command)
        _, pitch_rate, yaw_rate = self.damping * physics.rates()
        pump, driving = vehicle.steered_index("buoyancy"), vehicle.steered_index("speed")
        if pump is not None:
            command[pump] = vehicle.pump_for_net_mass(wanted.net_mass)
        if driving is not None:
            command[driving] = task.cruise.command[driving]
        trim, turn = self._trim(wanted.pitch, wanted.net_mass)
        pitching, turning = vehicle.steered("pitch"), vehicle.steered("heading")
        if pitching is not None:
            kp, _, kd = vehicle.pitch_pid
            loop = kp * (wanted.pitch - physics.pitch()) - kd * pitch_rate
            place = vehicle.part_names.index(pitching.name)
            command[place] = trim[place] + pitching.sense("pitch") * loop
        if turning is not None and wanted.heading is not None:
            kp, _, kd = vehicle.heading_pid
            error = wrap_angle(wanted.heading - physics.heading())
            rotation = turn * (kp * error - kd * yaw_rate)
            rotation = min(max(rotation, -LARGEST_ROTATION), LARGEST_ROTATION)
            command[vehicle.part_names.index(turning.name)] = rotation
        return task.to_action(vehicle.allocated(command))

    def _hold_pose(self, wanted: Reference, command: Array) -> None:
        """Write the thrusters' commands that bring the hull level to a pose, by `station_pid`."""
        task, physics = self._environment.task, self._environment.physics
        if physics.time() <= self._before:  # another episode
            self._integral[:] = 0.0
        self._before = physics.time()
        gains = np.array(task.vehicle.station_pid, float).reshape(4, 3)
        kp, ki, kd = gains[[0, 0, 1, 2]].T
        at = np.array([physics.north(), physics.east(), physics.depth(), physics.heading()])
        error = np.array([*np.array(wanted.position), wanted.heading], float) - at
        error[3] = wrap_angle(error[3])
        speed = np.zeros(3) if wanted.velocity is None else wanted.velocity
        rates = physics.rates()
        rate_error = np.append(speed - physics.velocity_over_ground(), -rates[2])
        near = np.abs(error) < 1.5  # m, rad: an approach does not wind it up
        self._integral += np.where(near, error, 0.0) * self.damping * task.period
        push = kp * error + ki * self._integral + self.damping * kd * rate_error
        roll, pitch = physics.roll(), physics.pitch()
        stiff, _, damped = gains[3]
        level = -stiff * np.array([roll, pitch]) - self.damping * damped * rates[:2]
        body = euler_to_matrix(roll, pitch, physics.heading()).T
        down, across = body @ [0.0, 0.0, push[2]], body @ [push[0], push[1], 0.0]
        table = np.zeros(GAINS)
        thruster_gains(task.vehicle, table)
        share_wrench(table, *down, *level, push[3], *across, command)

    def _trim(self, pitch: float, net_mass: float) -> tuple[Array, float]:
        """Positions that hold the steady motion, and the factor of the heading loop in it.

        Without such a motion: positions at rest, and the sense of the turning part.
        """
        key = (pitch, net_mass)
        if key not in self._trims:
            if len(self._trims) > 64:
                self._trims.clear()  # references that always change would fill the cache
            vehicle = self._environment.task.vehicle
            try:
                degrees = math.degrees(pitch)
                found = way(vehicle, "task", "pitch", degrees, net_mass, None, within_travel=True)
                self._trims[key] = found.command, turn_factor(vehicle, found)
            except MissionError:
                self._trims[key] = untrimmed(vehicle)
        return self._trims[key]


def untrimmed(vehicle: Vehicle) -> tuple[Array, float]:
    """Positions of the parts at rest, and the sense of the turning part."""
    turning = vehicle.steered("heading")
    return vehicle.rest, 1.0 if turning is None else turning.sense("heading")


class Proportional(Autopilot):
    """Policy that flies the task's reference by proportional gains, without rates and trims.

    The pump follows the target net buoyancy, and a propeller turns as in the cruise. The parts that
    pitch and turn the vehicle move in proportion to the error, by the gains of the vehicle file.
    """

    damping = 0.0

    def _trim(self, pitch: float, net_mass: float) -> tuple[Array, float]:
        return untrimmed(self._environment.task.vehicle)


def random(environment: Flown, seed: int) -> Policy:
    """Policy of uniformly sampled commands."""
    low, high = environment.task.action_range()
    generator = np.random.default_rng(seed)
    return lambda time_step: generator.uniform(low, high)


def still(environment: Flown, seed: int) -> Policy:
    """Policy that keeps every part at position 0."""
    action = environment.task.to_action(np.zeros(len(environment.task.vehicle.parts)))
    return lambda time_step: action


POLICIES: Mapping[str, Callable[[Flown, int], Policy]] = {
    "autopilot": lambda environment, _: Autopilot(environment),
    "proportional": lambda environment, _: Proportional(environment),
    "random": random,
    "still": still,
}
"""Makers of policies by name; the seed is only used by `random`."""
