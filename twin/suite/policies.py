"""Policies: pilots to compare with and to watch, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.suite.autopilot import LARGEST_ROTATION, Autopilot
from twin.suite.environment import Environment
from twin.suite.task import wrap_angle

Array = NDArray[np.float64]
Policy = Callable[[Any], Array]


class Proportional:
    """The task's reference flown by proportional gains alone, without rates and without trims.

    The pump follows the wanted net buoyancy, a propeller turns as in the cruise, and what pitches
    and turns the vehicle moves in proportion to the error, by the gains of the vehicle file.
    """

    def __init__(self, environment: Environment):
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
        return task.to_action(command)


def autopilot(environment: Environment, seed: int) -> Policy:
    """The suite's own pilot."""
    return Autopilot(environment)


def proportional(environment: Environment, seed: int) -> Policy:
    """Proportional gains alone."""
    return Proportional(environment)


def random(environment: Environment, seed: int) -> Policy:
    """Uniform commands."""
    spec = environment.action_spec()
    generator = np.random.default_rng(seed)
    return lambda time_step: generator.uniform(spec.minimum, spec.maximum)


def still(environment: Environment, seed: int) -> Policy:
    """Every actuator at its neutral position."""
    action = environment.task.to_action(np.zeros(environment.action_spec().shape))
    return lambda time_step: action


POLICIES: Mapping[str, Callable[[Environment, int], Policy]] = {
    "autopilot": autopilot,
    "proportional": proportional,
    "random": random,
    "still": still,
}
"""Makers by name; the seed is the random one's."""
