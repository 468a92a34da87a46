"""Bench: what the physics costs, against the bare MuJoCo step of the same model, in one run."""

from __future__ import annotations

import dataclasses
import statistics
import time

import mujoco
import numpy as np

from twin.mission import load_mission
from twin.mission.schedule import Schedule
from twin.physics.fleet import make_batch
from twin.physics.mujoco_model import parameter_block
from twin.physics.native import block as b
from twin.physics.native import plant
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.vehicle.vehicle import Vehicle

ROUNDS = 15
STEPS = 6000
"""Steps per timed stretch: about 20 ms"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BenchResult:
    """Costs measured side by side; medians over the rounds."""

    us_per_step: float
    """One thread, water, actuators, guidance and log on [us]"""
    us_per_step_bare_mujoco: float
    """The same model and motion without our callbacks [us]"""
    overhead_ratio: float
    """The first over the second"""
    us_per_step_with_guidance: float
    """Water, guidance and log on [us]"""
    times_real_time: float
    """Simulated over wall time of a batch of closed-loop missions on `threads`"""
    threads: int
    timestep_s: float
    missions: int


def bench(vehicle: Vehicle, *, threads: int, rounds: int = ROUNDS) -> BenchResult:
    """Measure; noise of the machine hits both sides of each ratio alike."""
    timestep, with_water, with_guidance, bare = 0.0, [], [], []
    actuators = (0.02, 0.5, vehicle.pump_for_net_mass(0.3))
    glide = Schedule(times=[0.0], commands=[actuators])
    scenario = Scenario(vehicle=vehicle, plan=glide, duration=600.0)
    mission = Scenario(vehicle=vehicle, plan=load_mission("default"))
    for _ in range(rounds):
        water_time = _stretch(_deep(scenario))
        weightless = _deep(scenario)
        weightless.model.opt.gravity[:] = 0.0  # without water it would fall out of range
        weightless.data.xfrc_applied[:] = 0.0
        plant.uninstall()
        try:
            bare_time = _stretch(weightless)
        finally:
            plant.install()
        guided = Simulation(mission)
        with_guidance.append(_stretch(guided))
        timestep = guided.model.opt.timestep
        with_water.append(water_time)
        bare.append(bare_time)
    count = 16 * threads
    rate = _times_real_time(mission, count, threads)
    return BenchResult(
        us_per_step=statistics.median(with_water),
        us_per_step_bare_mujoco=statistics.median(bare),
        overhead_ratio=statistics.median(with_water) / statistics.median(bare),
        us_per_step_with_guidance=statistics.median(with_guidance),
        times_real_time=rate,
        threads=threads,
        timestep_s=timestep,
        missions=count,
    )


def _deep(scenario: Scenario) -> Simulation:
    """A gliding simulation without guidance and log: the physics callbacks alone."""
    simulation = Simulation(scenario)
    block = parameter_block(simulation.model)
    block[b.P_CONTROL], block[b.P_LOG_PERIOD] = b.CONTROL_NONE, 0.0
    data = simulation.data
    data.qpos[2] = -500.0
    data.act[:] = data.ctrl[:] = np.asarray(scenario.plan.commands)[0]  # type: ignore[union-attr]
    data.qpos[7:9] = data.act[:2]
    data.qvel[0] = 0.4
    mujoco.mj_step(simulation.model, data, nstep=200)
    return simulation


def _stretch(simulation: Simulation) -> float:
    """Microseconds per step over one stretch."""
    begin = time.perf_counter()
    mujoco.mj_step(simulation.model, simulation.data, nstep=STEPS)
    return (time.perf_counter() - begin) / STEPS * 1e6


def _times_real_time(scenario: Scenario, count: int, threads: int) -> float:
    """A batch of closed-loop missions with log, stepped by MuJoCo's own thread pool."""
    fleet = make_batch([scenario] * count, threads=threads)
    duration = scenario.run_time()
    steps = fleet.steps
    warm = 200
    fleet.batch.step(nstep=warm)
    begin = time.perf_counter()
    fleet.batch.step(nstep=steps - warm)
    wall = time.perf_counter() - begin
    return count * duration * (steps - warm) / steps / wall
