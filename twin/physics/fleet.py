"""Fleet: many scenarios in one `mujoco.batch.Batch`, each with its own vehicle, water and plan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mujoco.batch import Batch

from twin.errors import InputError, SimulationUnstable
from twin.physics.lookup_tables import Plans, tables_of
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.native import block as b
from twin.physics.outcome import trajectory_of
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.records.trajectory import Trajectory


class Fleet:
    """Simulations side by side on MuJoCo's thread pool; bit-identical at any thread count.

    `batch` is an ordinary `mujoco.batch.Batch`: bind fields, write `ctrl`, step. Its models carry
    their own water, so it outlives the fleet. Step with `step` to keep the logs whole.
    """

    def __init__(self, scenarios: Sequence[Scenario], *, threads: int = 0):
        """Make all ready to step; `threads` 0 takes every core.

        Raises:
          InputError: no scenario, vehicles of different kinds, or one that cannot be built.
        """
        if not scenarios:
            raise InputError("a fleet needs at least one scenario")
        _check_alike(scenarios)
        if any(scenario.faults for scenario in scenarios):
            raise InputError(
                "a fleet is stepped natively, and faults change its vehicles between steps: fly "
                "them with simulate_many"
            )
        if any(scenario.navigate is not None for scenario in scenarios):
            raise InputError(
                "a fleet is stepped natively, and what is known on board is worked out in Python: "
                "fly navigated scenarios with simulate_many"
            )
        plans: Plans = {}
        tables = [tables_of(scenario, scenario.run_time(), plans) for scenario in scenarios]
        largest = max(table.words for table in tables)
        self.simulations = [
            Simulation(scenario, tables=table, reserve=largest)
            for scenario, table in zip(scenarios, tables, strict=True)
        ]
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

    def step(self, steps: int = 1) -> None:
        """Advance every simulation by `steps` physics steps; the logs stay whole."""
        at_most = min(s.steps_per_collection for s in self.simulations)
        userdata = self.batch.bind("userdata")
        while steps > 0:
            count = min(steps, at_most)
            self.batch.step(nstep=count)
            for simulation, mine in zip(self.simulations, userdata, strict=True):
                simulation.collect(mine)
            steps -= count

    def trajectory(self, index: int) -> Trajectory:
        """Samples of one simulation so far; raises SimulationUnstable with the partial ones."""
        simulation, userdata = self.simulations[index], self.batch.bind("userdata")[index]
        simulation.collect(userdata)
        ours = userdata[: b.STATE_WORDS].view(b.STATE)[0]
        rows = simulation.collected
        return trajectory_of(simulation.scenario, simulation.model, rows, ours, index)

    def run(self) -> list[Trajectory | SimulationUnstable]:
        """Step every simulation to the end of the longest and collect all."""
        with quiet_mujoco():
            self.step(self.steps)
        results: list[Trajectory | SimulationUnstable] = []
        for index in range(len(self.simulations)):
            try:
                results.append(self.trajectory(index))
            except SimulationUnstable as error:
                results.append(error)
        return results


def _check_alike(scenarios: Sequence[Scenario]) -> None:
    """One batch steps models of one structure: the same parts, masses, water law and step."""

    def structure(scenario: Scenario) -> tuple[object, ...]:
        vehicle = scenario.vehicle
        kinds = tuple((part.name, part.kind) for part in vehicle.parts)
        return kinds, tuple(mass.name for mass in vehicle.masses), vehicle.law.values().size

    first = scenarios[0]
    for index, scenario in enumerate(scenarios[1:], start=1):
        if structure(scenario) != structure(first) or (
            scenario.hydrodynamics != first.hydrodynamics
        ):
            raise InputError(
                f"a fleet flies vehicles of one kind: scenario 0 has {first.vehicle.name!r} "
                f"({', '.join(first.vehicle.part_names)}; {first.hydrodynamics}), scenario {index} "
                f"has {scenario.vehicle.name!r} ({', '.join(scenario.vehicle.part_names)}; "
                f"{scenario.hydrodynamics}); make a fleet of each, or use simulate_many"
            )
