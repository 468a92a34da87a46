"""Fleet: simulations stepped from outside, many in one MuJoCo batch or one by one.

Each simulation has its own vehicle, water and plan. A caller commands a stepped vehicle.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from mujoco.batch import Batch

from twin.errors import InputError, SimulationUnstable
from twin.mission.controller import Command, Observation
from twin.physics.model_block import Plans, tables_of
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.physics.simulation import Saved, Simulation, observe
from twin.physics.true_signals import LiveTruth
from twin.records.trajectory import Trajectory


class Fleet:
    """Simulations side by side on MuJoCo's thread pool; bit-identical at any thread count.

    `batch` is an ordinary `mujoco.batch.Batch`: bind fields, write `ctrl`, step. Its models hold
    their own water, so the batch outlives the fleet. Only `Fleet.step` keeps the logs complete.
    """

    def __init__(self, scenarios: Sequence[Scenario], *, threads: int = 0):
        """Make all simulations ready to step; `threads` 0 takes every core.

        Raises:
          InputError: no scenario, vehicles of different structure, or an impossible scenario.
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
        self.batch = Batch(self.simulations[0].model, len(scenarios), threads)
        self.batch.set_models([s.model for s in self.simulations])
        for name in ("qpos", "qvel", "act", "ctrl", "userdata"):
            values = np.array([getattr(s.data, name) for s in self.simulations])
            self.batch.bind(name)[...] = values

    @property
    def steps(self) -> int:
        """Steps of the longest scenario."""
        return max(s.steps for s in self.simulations)

    def step(self, steps: int = 1) -> None:
        """Advance every simulation by `steps` physics steps and keep the logs complete."""
        at_most = min(s.steps_per_collection for s in self.simulations)
        userdata = self.batch.bind("userdata")
        while steps > 0:
            count = min(steps, at_most)
            self.batch.step(nstep=count)
            for simulation, mine in zip(self.simulations, userdata, strict=True):
                simulation.collect(mine)
            steps -= count

    def trajectory(self, index: int) -> Trajectory:
        """Trajectory of one simulation so far; SimulationUnstable holds the partial one."""
        userdata = self.batch.bind("userdata")[index]
        return self.simulations[index].trajectory(index, userdata=userdata)

    def run(self) -> list[Trajectory | SimulationUnstable]:
        """Step every simulation to the end of the longest one; return all results."""
        with quiet_mujoco():
            self.step(self.steps)
        return [self._result(index) for index in range(len(self.simulations))]

    def _result(self, index: int) -> Trajectory | SimulationUnstable:
        try:
            return self.trajectory(index)
        except SimulationUnstable as error:
            return error


def _check_alike(scenarios: Sequence[Scenario]) -> None:
    """Refuse models of different structure: parts, masses, law and hydrodynamics must agree."""

    def structure(scenario: Scenario) -> tuple[object, ...]:
        vehicle = scenario.vehicle
        kinds = tuple((part.name, part.kind) for part in vehicle.parts)
        masses = tuple(mass.name for mass in vehicle.masses)
        return kinds, masses, vehicle.law.values().size, scenario.hydrodynamics

    first = scenarios[0]
    for index, scenario in enumerate(scenarios[1:], start=1):
        if structure(scenario) != structure(first):
            raise InputError(
                f"a fleet flies vehicles of one kind: scenario 0 has {first.vehicle.name!r} "
                f"({', '.join(first.vehicle.part_names)}; {first.hydrodynamics}), scenario {index} "
                f"has {scenario.vehicle.name!r} ({', '.join(scenario.vehicle.part_names)}; "
                f"{scenario.hydrodynamics}); make a fleet of each, or use simulate_many"
            )


_OF_THE_WATER = frozenset(
    ("true_surge", "true_sway", "true_heave", "true_current_north", "true_current_east",
     "true_current_down", "true_net_mass", "true_density", "true_immersion")
)  # fmt: skip
"""Signals of a log row that only native code knows, at the time of a sample."""


class SteppedVehicle:
    """A vehicle that moves only when `step` is called.

    Its motion equals that of `twin.simulate` with the same commands, bit for bit.
    """

    def __init__(self, scenario: Scenario) -> None:
        """Put the vehicle at the start.

        Args:
          scenario: scenario without a mission; its `duration` limits the flown time.

        Raises:
          InputError: the scenario has a mission or `navigate`, which would command the vehicle too.
        """
        if scenario.mission is not None or scenario.navigate is not None:
            raise InputError(
                "a stepped vehicle is commanded from outside: leave the mission and navigate out "
                "of the scenario, and give a duration"
            )
        self.vehicle = scenario.vehicle
        with quiet_mujoco():
            self._simulation = Simulation(scenario)
        self._truth = LiveTruth(
            scenario.vehicle,
            self._simulation.rows.dtype,
            half_step=self._simulation.half_step,
            floor=self._simulation.tables.floor,
        )
        self._change = np.zeros(6)
        self._done = 0

    @property
    def timestep(self) -> float:
        """[s] Step of the physics; every control step is a multiple of it."""
        return float(self._simulation.model.opt.timestep)

    @property
    def time(self) -> float:
        """[s] Time flown so far."""
        return float(self._simulation.data.time)

    @property
    def ended(self) -> bool:
        """True when the scenario's duration is over or the state is no longer finite."""
        return self._done >= self._simulation.steps or self._simulation.failed

    def step(self, command: Command, seconds: float | None = None) -> Observation:
        """Hold a command for a time and return the observation at its end.

        Args:
          command: positions by part; parts that are left out go to rest.
          seconds: [s], rounded to physics steps, at least one; None: the vehicle's control period.

        Raises:
          InputError: an unknown part, a time that is not positive, or a duration that is over.
        """
        seconds = self.vehicle.control_period if seconds is None else seconds
        if not 0.0 < seconds < float("inf"):
            raise InputError(f"a step takes a time above 0 s, not {seconds:g}")
        if self.ended:
            raise InputError(
                f"the vehicle has flown its duration, {self.time:g} s, or went unstable: "
                "reset() it, or give a longer duration"
            )
        simulation = self._simulation
        simulation.data.ctrl[:] = command.as_array(self.vehicle)
        steps = max(1, round(seconds / self.timestep))
        steps = min(steps, simulation.steps - self._done)
        simulation.step(steps - 1)
        before = simulation.data.qvel[:6].copy()
        simulation.step(1)
        self._change = (simulation.data.qvel[:6] - before) / self.timestep
        self._done += steps
        return self.seen()

    def fly(
        self,
        controller: Callable[[Observation], Command],
        seconds: float,
        *,
        pace: float = 0.0,
        every: float | None = None,
    ) -> None:
        """Let a controller command the vehicle for some time.

        Args:
          controller: called with the observation before each step.
          seconds: [s] of the vehicle's time.
          pace: simulated seconds per second of wall time: 1 is real time, 0.5 half as fast; 0 runs
            without waiting.
          every: [s] between two calls; None: the vehicle's control period.
        """
        begun, first = time.monotonic(), self.time
        while self.time - first < seconds - 0.5 * self.timestep and not self.ended:
            if pace > 0.0:
                time.sleep(max(0.0, begun + (self.time - first) / pace - time.monotonic()))
            self.step(controller(self.seen()), every)

    def seen(self) -> Observation:
        """Observation for a controller at this time."""
        simulation = self._simulation
        return observe(simulation.data, self.vehicle, simulation.tables.floor)

    def state(self) -> dict[str, float]:
        """Position, velocity over ground, attitude, rates, specific force and part positions now.
        Names (`true_north` ...) and units are those of a store; the force is from the last step."""
        data = self._simulation.data
        row = np.zeros(1, self._simulation.rows.dtype)[0]
        for name, values in (("qpos", data.qpos), ("qvel", data.qvel)):
            row[name] = values
        row["act"], row["ctrl"] = data.act, data.ctrl
        signals = self._truth.sample(row, self._change)
        return {name: value for name, value in signals.items() if name not in _OF_THE_WATER}

    def failsafe(self) -> Command:
        """Failsafe command: parts that can bring the vehicle up do so, all others rest."""
        return Command(**{part.name: part.failsafe for part in self.vehicle.parts})

    def saved(self) -> tuple[Saved, int]:
        """Save the state, from which `restore` continues."""
        return self._simulation.saved(), self._done

    def restore(self, saved: tuple[Saved, int]) -> None:
        """Continue from a state that `saved` returned."""
        self._simulation.restore(saved[0])
        self._done = saved[1]

    def reset(self) -> None:
        """Return to the start, with an empty log."""
        self._simulation.reset()
        self._change, self._done = np.zeros(6), 0

    def trajectory(self) -> Trajectory:
        """Trajectory flown so far, as from `twin.simulate`.

        Raises:
          SimulationUnstable: the run went unstable; `partial` holds the finite samples.
        """
        return self._simulation.trajectory()
