"""Step cost: what the physics costs, against the bare MuJoCo step of the same model, in one run."""

from __future__ import annotations

import dataclasses
import statistics
import time

import mujoco
import numpy as np

from twin.mission.shipped_missions import load_mission_for
from twin.physics.fleet import Fleet
from twin.physics.initial_state import set_start
from twin.physics.mujoco_model import compile_model
from twin.physics.native.install import install, uninstall
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.physics.start import Start
from twin.vehicle.vehicle import Vehicle

ROUNDS, BATCHES = 40, 3
"""Pairs of stretches; which of the two comes first changes from pair to pair"""
STEPS = 2000
"""Steps per timed stretch: about 5 ms, shorter than what other processes take away at once"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BenchResult:
    """Costs measured side by side; medians over the pairs."""

    us_per_step: float
    """One thread, water and parts on, without guidance and log [us]"""
    us_per_step_bare_mujoco: float
    """The same model and motion without our callbacks [us]"""
    overhead_ratio: float
    """Median over the pairs of the first over the second"""
    overhead_quartiles: tuple[float, float]
    """A quarter of the pairs lies below the first, a quarter above the second"""
    us_per_step_with_guidance: float
    """Water, guidance and log on [us]"""
    times_real_time: float
    """Simulated over wall time of a batch of closed-loop missions on `threads`; the best of
    BATCHES, or of as many as there are pairs"""
    threads: int
    timestep_s: float
    missions: int
    pairs: int


def bench(vehicle: Vehicle, *, threads: int, rounds: int = ROUNDS) -> BenchResult:
    """Measure; noise of the machine hits both sides of each pair alike."""
    rng = np.random.default_rng(0)
    command = tuple(part.manoeuvre(rng, 1.0, vehicle) for part in vehicle.parts)
    start = Start(depth=500.0, v_rel=(0.4, 0.0, 0.0), actuators=command)
    mission = Scenario(vehicle=vehicle, mission=load_mission_for(vehicle))
    wet, dry, guided = _UnderWay(vehicle, start), _UnderWay(vehicle, start), Simulation(mission)
    dry.model.opt.gravity[:] = 0.0  # without water it would fall out of range
    dry.data.xfrc_applied[:] = 0.0
    with_water, bare, with_guidance = [], [], []
    for index in range(rounds):
        if index % 2:
            bare.append(_bare_stretch(dry))
            with_water.append(_stretch(wet))
        else:
            with_water.append(_stretch(wet))
            bare.append(_bare_stretch(dry))
        guided.reset()
        with_guidance.append(_stretch(guided))
    ratios = sorted(a / c for a, c in zip(with_water, bare, strict=True))
    quarter = len(ratios) // 4
    count, batches = 16 * threads, min(rounds, BATCHES)
    return BenchResult(
        us_per_step=statistics.median(with_water),
        us_per_step_bare_mujoco=statistics.median(bare),
        overhead_ratio=statistics.median(ratios),
        overhead_quartiles=(ratios[quarter], ratios[-1 - quarter]),
        us_per_step_with_guidance=statistics.median(with_guidance),
        times_real_time=max(_times_real_time(mission, count, threads) for _ in range(batches)),
        threads=threads,
        timestep_s=guided.model.opt.timestep,
        missions=count,
        pairs=rounds,
    )


def _bare_stretch(simulation: _UnderWay) -> float:
    """A stretch of the same model without our callbacks."""
    uninstall()
    try:
        return _stretch(simulation)
    finally:
        install()


class _UnderWay:
    """A vehicle in water without guidance and log: the physics callbacks alone."""

    def __init__(self, vehicle: Vehicle, start: Start) -> None:
        self.model = compile_model(vehicle, lean=True, centred=True)
        self.data = mujoco.MjData(self.model)
        set_start(self.model, self.data, start, np.zeros(3))
        mujoco.mj_step(self.model, self.data, nstep=200)


def _stretch(simulation: _UnderWay | Simulation) -> float:
    """Microseconds per step over one stretch."""
    begin = time.perf_counter()
    mujoco.mj_step(simulation.model, simulation.data, nstep=STEPS)
    return (time.perf_counter() - begin) / STEPS * 1e6


def _times_real_time(scenario: Scenario, count: int, threads: int) -> float:
    """A batch of closed-loop missions with log, stepped by MuJoCo's own thread pool."""
    fleet = Fleet([scenario] * count, threads=threads)
    duration = scenario.run_time()
    steps = fleet.steps
    warm = 200
    fleet.step(warm)
    begin = time.perf_counter()
    fleet.step(steps - warm)
    wall = time.perf_counter() - begin
    return count * duration * (steps - warm) / steps / wall
