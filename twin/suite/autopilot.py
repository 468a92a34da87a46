"""Autopilot: a simple pilot for every task, to watch and to compare with."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import MissionError
from twin.mission.glide import steady_glide
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
        self._trim: dict[tuple[float, float], float] = {}

    def __call__(self, time_step: Any = None) -> Array:
        """The action now; dm_control's viewer hands over the time step, which is not needed."""
        task, physics = self._environment.task, self._environment.physics
        vehicle = task.vehicle
        wanted = task.reference(physics)
        kp, _, kd = vehicle.pitch_pid
        _, pitch_rate, yaw_rate = physics.rates()
        shift = self._trim_shift(wanted.pitch, wanted.net_mass)
        shift -= kp * (wanted.pitch - physics.pitch()) - kd * pitch_rate
        rotation = 0.0
        if wanted.heading is not None:
            kp, _, kd = vehicle.heading_pid
            error = wrap_angle(wanted.heading - physics.heading())
            rotation = kp * error - kd * yaw_rate
            rotation = min(max(rotation, -LARGEST_ROTATION), LARGEST_ROTATION)
        pump = vehicle.pump_for_net_mass(wanted.net_mass)
        return task.to_action([shift, rotation, pump])

    def _trim_shift(self, pitch: float, net_mass: float) -> float:
        """Shift [m] that holds the glide, or 0 where there is none to hold."""
        key = (pitch, net_mass)
        if key not in self._trim:
            if len(self._trim) > 64:
                self._trim.clear()  # references that change all the time have no trim to keep
            try:
                self._trim[key] = steady_glide(self._environment.task.vehicle, *key).shift
            except MissionError:
                self._trim[key] = 0.0
        return self._trim[key]
