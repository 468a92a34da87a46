"""Fleet: many scenarios in one `mujoco.batch.Batch`, each with its own vehicle, water and plan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mujoco.batch import Batch

from twin.errors import InputError, SimulationUnstable
from twin.physics.outcome import collect
from twin.physics.quiet import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.records.trajectory import Trajectory


class Fleet:
    """Simulations side by side on MuJoCo's thread pool; bit-identical at any thread count.

    `batch` is an ordinary `mujoco.batch.Batch`: bind fields, write `ctrl`, step. The fleet owns
    the tables that native code reads, so keep it as long as the batch.
    """

    def __init__(self, scenarios: Sequence[Scenario], *, threads: int = 0):
        if not scenarios:
            raise InputError("a fleet needs at least one scenario")
        self.simulations = [Simulation(scenario) for scenario in scenarios]
        first = self.simulations[0]
        self.batch = Batch(first.model, len(scenarios), threads)
        self.batch.set_models([s.model for s in self.simulations])
        for name in ("qpos", "qvel", "act", "ctrl", "userdata"):
            values = np.array([getattr(s.data, name) for s in self.simulations])
            self.batch.bind(name)[...] = values

    @property
    def steps(self) -> int:
        """Steps of the longest scenario."""
        return max(s.steps for s in self.simulations)

    def trajectory(self, index: int) -> Trajectory:
        """Samples of one simulation so far; raises SimulationUnstable with the partial ones."""
        return collect(self.simulations[index], self.batch.bind("userdata")[index], index)

    def run(self) -> list[Trajectory | SimulationUnstable]:
        """Step every simulation to the end of the longest and collect all."""
        with quiet_mujoco():
            self.batch.step(nstep=self.steps)
        results: list[Trajectory | SimulationUnstable] = []
        for index in range(len(self.simulations)):
            try:
                results.append(self.trajectory(index))
            except SimulationUnstable as error:
                results.append(error)
        return results


def make_batch(scenarios: Sequence[Scenario], *, threads: int = 0) -> Fleet:
    """A fleet ready to step; `threads` 0 takes every core.

    Raises:
      InputError: no scenario, or one that cannot be built.
    """
    return Fleet(scenarios, threads=threads)
