"""Turns: the twin flown with the positions of the log's turning part, so that both have one input.

In closed loop a twin in calm water hardly moves its rudder, where the log's works against waves and
a compass' noise. Here pitch and pump stay in closed loop and the heading is left to itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.checks.logs.dive import Dive
from twin.checks.logs.flight import mission_of, scenario_of
from twin.checks.logs.steering import Turning
from twin.mission.controller import Command, MissionController, Observation
from twin.physics.quiet import quiet_mujoco
from twin.physics.simulation import Simulation
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]


class _Turned:
    """Guidance whose turning part follows the log's positions from the start of each leg."""

    def __init__(self, vehicle: Vehicle, dive: Dive, part: str, positions: Array):
        self._guidance = MissionController(mission_of(vehicle, dive), vehicle)
        self._legs = [k for k, target in enumerate(dive.targets) for _ in target.pieces]
        self._dive, self._part, self._positions = dive, part, positions
        self.begun: list[tuple[float, int]] = []
        """[s] and number of each leg, -1 for the end"""

    def __call__(self, observation: Observation) -> Command:
        command = self._guidance(observation)
        leg = -1
        if not self._guidance.done:
            leg = self._legs[min(self._guidance.segment, len(self._legs) - 1)]
        if not self.begun or leg != self.begun[-1][1]:
            self.begun.append((observation.time, leg))
        if leg < 0:
            return command
        logged = self._dive.targets[leg].leg
        since = round((observation.time - self.begun[-1][0]) / self._dive.period)
        position = float(self._positions[min(logged.first + since, logged.last)])
        return Command(**{**command, self._part: position})

    def legs(self, time: Array) -> Array:
        """Number of the leg at each time [s], (time,); -1 where none is flown."""
        times, numbers = zip(*self.begun, strict=True)
        return np.array(numbers)[np.searchsorted(times, time, side="right") - 1]


def fly_turns(
    vehicle: Vehicle, dive: Dive, flown: Trajectory, turning: Turning
) -> tuple[Trajectory, Array]:
    """A dive with the log's turns, and the number of the leg at each sample, (time,).

    Args:
      flown: the twin's flight of the dive in closed loop, which says how long it takes.
      turning: whose part is of the log's kind.

    Raises:
      SimulationUnstable: with the trajectory up to that time as `partial`.
    """
    assert dive.turning is not None
    part = vehicle.part(turning.part)
    positions = np.clip(turning.sense * dive.turning / part.quantity.scale, part.low, part.high)
    controller = _Turned(vehicle, dive, part.name, positions)
    scenario = scenario_of(vehicle, dive, float(flown.time[-1]), plan=False)
    with quiet_mujoco():
        trajectory = Simulation(scenario).run(controller, mission=dive.row)
    return trajectory, controller.legs(trajectory.time)
