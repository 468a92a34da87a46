"""Policies: pilots to compare with and to watch, by name.

They read the physics and not the observation, so they know what the task knows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from twin.control.physics import WaterPhysics
from twin.control.task import GliderTask, wrap_angle
from twin.errors import MissionError
from twin.mission.turning import turn_factor
from twin.mission.way import way
from twin.numbers import Array

Policy = Callable[[Any], Array]


class Flown(Protocol):
    """What a pilot needs of an environment, of either face."""

    @property
    def task(self) -> GliderTask:
        """The task that it flies."""

    @property
    def physics(self) -> WaterPhysics:
        """The vehicle that it flies."""


LARGEST_ROTATION = math.radians(60.0)
"""[rad] beyond it a climbing glider can roll over"""


class Autopilot:
    """Flies the task's reference with the vehicle's own gains: a policy for a viewer or a loop.

    It reads the physics and not the observation, so it knows what the task knows.
    """

    def __init__(self, environment: Flown):
        self._environment = environment
        self._trims: dict[tuple[float, float], tuple[Array, float]] = {}

    def __call__(self, time_step: Any = None) -> Array:
        """The action now; dm_control's viewer hands over the time step, which is not needed."""
        task, physics = self._environment.task, self._environment.physics
        vehicle = task.vehicle
        wanted = task.reference(physics)
        command = vehicle.rest
        _, pitch_rate, yaw_rate = physics.rates()
        pump, driving = vehicle.steered_index("buoyancy"), vehicle.steered_index("speed")
        if pump is not None:
            command[pump] = vehicle.pump_for_net_mass(wanted.net_mass)
        if driving is not None:
            command[driving] = task.cruise.command[driving]
        trim, turn = self._trim(wanted.pitch, wanted.net_mass)
        pitching = vehicle.steered("pitch")
        if pitching is not None:
            kp, _, kd = vehicle.pitch_pid
            loop = kp * (wanted.pitch - physics.pitch()) - kd * pitch_rate
            place = vehicle.part_names.index(pitching.name)
            command[place] = trim[place]
            command[place] += pitching.sense("pitch") * loop
        turning = vehicle.steered("heading")
        if turning is not None and wanted.heading is not None:
            kp, _, kd = vehicle.heading_pid
            error = wrap_angle(wanted.heading - physics.heading())
            loop = kp * error - kd * yaw_rate
            rotation = min(max(turn * loop, -LARGEST_ROTATION), LARGEST_ROTATION)
            command[vehicle.part_names.index(turning.name)] = rotation
        return task.to_action(vehicle.allocated(command))

    def _trim(self, pitch: float, net_mass: float) -> tuple[Array, float]:
        """Positions that hold the steady way, and what the heading loop is multiplied by there.

        At rest, and by the part's own sense, where there is no such way.
        """
        key = (pitch, net_mass)
        if key not in self._trims:
            if len(self._trims) > 64:
                self._trims.clear()  # references that change all the time have no trim to keep
            vehicle = self._environment.task.vehicle
            try:
                degrees = math.degrees(pitch)
                found = way(vehicle, "task", "pitch", degrees, net_mass, None, within_travel=True)
                self._trims[key] = found.command, turn_factor(vehicle, found)
            except MissionError:
                turning = vehicle.steered("heading")
                sense = 1.0 if turning is None else turning.sense("heading")
                self._trims[key] = vehicle.rest, sense
        return self._trims[key]


class Proportional:
    """The task's reference flown by proportional gains alone, without rates and without trims.

    The pump follows the wanted net buoyancy, a propeller turns as in the cruise, and what pitches
    and turns the vehicle moves in proportion to the error, by the gains of the vehicle file.
    """

    def __init__(self, environment: Flown):
        self._environment = environment

    def __call__(self, time_step: Any = None) -> Array:
        """The action now."""
        task, physics = self._environment.task, self._environment.physics
        vehicle, wanted = task.vehicle, task.reference(physics)
        command = vehicle.rest
        pump, driving = vehicle.steered_index("buoyancy"), vehicle.steered_index("speed")
        if pump is not None:
            command[pump] = vehicle.pump_for_net_mass(wanted.net_mass)
        if driving is not None:
            command[driving] = task.cruise.command[driving]
        pitching, turning = vehicle.steered("pitch"), vehicle.steered("heading")
        if pitching is not None:
            moved = vehicle.pitch_pid[0] * (wanted.pitch - physics.pitch())
            command[vehicle.part_names.index(pitching.name)] += pitching.sense("pitch") * moved
        if turning is not None and wanted.heading is not None:
            error = wrap_angle(wanted.heading - physics.heading())
            moved = turning.sense("heading") * vehicle.heading_pid[0] * error
            moved = min(max(moved, -LARGEST_ROTATION), LARGEST_ROTATION)
            command[vehicle.part_names.index(turning.name)] = moved
        return task.to_action(vehicle.allocated(command))


def autopilot(environment: Flown, seed: int) -> Policy:
    """The suite's own pilot."""
    return Autopilot(environment)


def proportional(environment: Flown, seed: int) -> Policy:
    """Proportional gains alone."""
    return Proportional(environment)


def random(environment: Flown, seed: int) -> Policy:
    """Uniform commands."""
    low, high = environment.task.action_range()
    generator = np.random.default_rng(seed)
    return lambda time_step: generator.uniform(low, high)


def still(environment: Flown, seed: int) -> Policy:
    """Every actuator at its neutral position."""
    action = environment.task.to_action(np.zeros(len(environment.task.vehicle.parts)))
    return lambda time_step: action


POLICIES: Mapping[str, Callable[[Flown, int], Policy]] = {
    "autopilot": autopilot,
    "proportional": proportional,
    "random": random,
    "still": still,
}
"""Makers by name; the seed is the random one's."""
