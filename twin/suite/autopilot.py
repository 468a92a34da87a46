"""Autopilot: a simple pilot for every task, to watch and to compare with."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import MissionError
from twin.mission.turning import turn_factor
from twin.mission.way import way
from twin.suite.environment import Environment
from twin.suite.task import wrap_angle

Array = NDArray[np.float64]

LARGEST_ROTATION = math.radians(60.0)
"""[rad] beyond it a climbing glider can roll over"""


class Autopilot:
    """Flies the task's reference with the vehicle's own gains: a policy for a viewer or a loop.

    It reads the physics and not the observation, so it knows what the task knows.
    """

    def __init__(self, environment: Environment):
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
        return task.to_action(command)

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
