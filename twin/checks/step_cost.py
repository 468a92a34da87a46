"""Step cost: time of our physics against a bare MuJoCo step of the same model, in one run.

For lanes: time of closed-loop missions against that of the arithmetic of their structure alone.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import math
import statistics
import time
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from twin.compiled import jit
from twin.compiled.portable import call_rate
from twin.fossen.lane_block import LANES
from twin.mission.shipped_missions import load_mission_for
from twin.physics.condition import set_start
from twin.physics.fleet import Fleet
from twin.physics.lanes import Lane, LaneBlock, fly_in_lanes
from twin.physics.mujoco_model import compile_model
from twin.physics.native.install import install, stop_timers, uninstall
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.physics.start import Start
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle
from twin.water.current.base import parse_current
from twin.water.density import parse_density

ROUNDS, BATCHES = 40, 3
"""ROUNDS: measured pairs of stretches, in alternating order. BATCHES: number of batches."""
STEPS = 2000
"""Steps per timed stretch: about 5 ms, shorter than another process's time slice."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BenchResult:
    """Costs measured side by side, as medians of the pairs."""

    us_per_step: float
    """Time of a step with water and parts, without guidance and log, on one thread [us]."""
    us_per_step_bare_mujoco: float
    """Time of a bare step: the same model and motion without our callbacks [us]."""
    us_per_step_untimed: float
    """Time of a bare step without the clock of MuJoCo's timers, which `install` removes [us]."""
    overhead_ratio: float
    """Median of the pairs' ratios `us_per_step` / `us_per_step_bare_mujoco`."""
    overhead_ratio_untimed: float
    """Median of the pairs' ratios `us_per_step` / `us_per_step_untimed`."""
    overhead_quartiles: tuple[float, float]
    """Lower and upper quartile of the pairs' `overhead_ratio`."""
    us_per_step_with_guidance: float
    """Time of a step with water, guidance and log [us]."""
    times_real_time: float
    """Simulated over wall time of a batch of closed-loop missions on `threads`: best of BATCHES, or
    of fewer if there are fewer pairs."""
    threads: int
    timestep_s: float
    missions: int
    pairs: int


def bench(vehicle: Vehicle, *, threads: int, rounds: int = ROUNDS) -> BenchResult:
    """Measure all costs; other work of the machine slows both stretches of a pair alike."""
    rng = np.random.default_rng(0)
    command = tuple(part.manoeuvre(rng, 1.0, vehicle) for part in vehicle.parts)
    start = Start(depth=500.0, v_rel=(0.4, 0.0, 0.0), actuators=command)
    mission = Scenario(vehicle=vehicle, mission=load_mission_for(vehicle))
    wet, dry, guided = _UnderWay(vehicle, start), _UnderWay(vehicle, start), Simulation(mission)
    dry.model.opt.gravity[:] = 0.0  # without water gravity would move it out of range
    dry.data.xfrc_applied[:] = 0.0
    with_water, bare, untimed, with_guidance = (list[float]() for _ in range(4))
    turn: list[Callable[[], None]] = [
        lambda: with_water.append(_time_steps(wet)),
        lambda: untimed.append(_time_bare_steps(dry, timers=False)),
        lambda: bare.append(_time_bare_steps(dry)),
    ]
    for _ in range(rounds):
        for measure in turn:
            measure()
        turn.reverse()
        guided.reset()
        with_guidance.append(_time_steps(guided))
    ratios = sorted(a / c for a, c in zip(with_water, bare, strict=True))
    over_untimed = statistics.median(a / c for a, c in zip(with_water, untimed, strict=True))
    quarter = len(ratios) // 4
    count, batches = 16 * threads, min(rounds, BATCHES)
    return BenchResult(
        us_per_step=statistics.median(with_water),
        us_per_step_bare_mujoco=statistics.median(bare),
        us_per_step_untimed=statistics.median(untimed),
        overhead_ratio=statistics.median(ratios),
        overhead_ratio_untimed=over_untimed,
        overhead_quartiles=(ratios[quarter], ratios[-1 - quarter]),
        us_per_step_with_guidance=statistics.median(with_guidance),
        times_real_time=max(_times_real_time(mission, count, threads) for _ in range(batches)),
        threads=threads,
        timestep_s=guided.model.opt.timestep,
        missions=count,
        pairs=rounds,
    )


def _time_bare_steps(simulation: _UnderWay, *, timers: bool = True) -> float:
    """Time a stretch of steps without our callbacks, with or without MuJoCo's timers."""
    uninstall()
    if not timers:
        stop_timers()
    try:
        return _time_steps(simulation)
    finally:
        install()


class _UnderWay:
    """Vehicle in water without guidance and log: the physics callbacks alone."""

    def __init__(self, vehicle: Vehicle, start: Start) -> None:
        self.model = compile_model(vehicle, lean=True, centred=True)
        self.data = mujoco.MjData(self.model)
        set_start(self.model, self.data, start, np.zeros(3))
        mujoco.mj_step(self.model, self.data, nstep=200)


def _time_steps(simulation: _UnderWay | Simulation) -> float:
    """Time one stretch [us per step]."""
    begin = time.perf_counter()
    mujoco.mj_step(simulation.model, simulation.data, nstep=STEPS)
    return (time.perf_counter() - begin) / STEPS * 1e6


def _times_real_time(scenario: Scenario, count: int, threads: int) -> float:
    """Simulated over wall time of closed-loop missions with log, on MuJoCo's thread pool."""
    fleet = Fleet([scenario] * count, threads=threads)
    duration = scenario.run_time()
    steps = fleet.steps
    warm = 200
    fleet.step(warm)
    begin = time.perf_counter()
    fleet.step(steps - warm)
    wall = time.perf_counter() - begin
    return count * duration * (steps - warm) / steps / wall


CURRENT = "ekman:tau=0.1,direction=90+geostrophic:surface=0.2,direction=45,scale=800"
DENSITY = "thermocline"
"""Current and density of the benchmark of lanes: sheared, and tabulated."""
BLOCKS_PER_THREAD = 1
ALONE = 2000
"""Number of consecutive calls of the structure's function."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LanesBenchResult:
    """Costs of lanes, each the best of three. Costs on one core are in processor time, which
    other work on the machine does not change."""

    times_real_time: float
    """Simulated over wall time of closed-loop missions on `threads`, with water, guidance, log."""
    times_real_time_one_core: float
    """Simulated over processor time of one block on one thread."""
    times_real_time_to_signals: float
    """Simulated over wall time on `threads` from scenarios to trajectories, compiling included."""
    limit_one_core: float
    """Simulated over processor time of one block that only calls the structure's function."""
    part_of_limit: float
    """`times_real_time_one_core` over `limit_one_core`."""
    ns_per_step: float
    """Time of a complete step of one vehicle on one core [ns]."""
    threads: int
    timestep_s: float
    missions: int


def bench_scenario(vehicle: Vehicle, number: int = 0) -> Scenario:
    """Scenario `number` of the benchmark: the vehicle's shipped mission, on a heading of its own,
    in sheared and stratified water."""
    scenario = Scenario(
        vehicle=vehicle, mission=load_mission_for(vehicle), engine="lanes",
        current=parse_current(CURRENT),
    )  # fmt: skip
    place = scenario.place
    water = parse_density(DENSITY, latitude=place.latitude_deg, longitude=place.longitude_deg)
    turned = scenario.begin.heading + 2.0 * math.pi * (number % LANES[-1]) / LANES[-1]
    start = {"heading": turned} if number else None
    return dataclasses.replace(scenario, density=water, start=start)


def bench_lanes(vehicle: Vehicle, *, threads: int) -> LanesBenchResult:
    """Measure the cost of lanes through `LaneBlock.fly`, which `simulate` calls as well."""
    count = LANES[-1] * BLOCKS_PER_THREAD * threads
    scenarios = [bench_scenario(vehicle, number) for number in range(count)]
    lanes = [Lane(scenario) for scenario in scenarios]
    blocks = [lanes[k : k + LANES[-1]] for k in range(0, count, LANES[-1])]
    _fly_on_core(blocks[0])  # compiles
    one = max(_fly_on_core(blocks[0]) for _ in range(3))
    alone = _time_arithmetic(blocks[0])
    begin = time.perf_counter()
    flown = fly_in_lanes(scenarios, threads=threads)
    wall = time.perf_counter() - begin
    simulated = sum(float(found.time[-1]) for found in flown if isinstance(found, Trajectory))
    step = lanes[0].timestep
    return LanesBenchResult(
        times_real_time=max(fly_blocks(blocks, threads) for _ in range(3)),
        times_real_time_one_core=one,
        times_real_time_to_signals=simulated / wall,
        limit_one_core=alone,
        part_of_limit=one / alone,
        ns_per_step=1e9 * step / one,
        threads=threads,
        timestep_s=step,
        missions=count,
    )


def fly_blocks(blocks: Sequence[Sequence[Lane]], threads: int) -> float:
    """Simulated over wall time of blocks on `threads` threads."""
    ready = [LaneBlock(lanes) for lanes in blocks]
    begin = time.perf_counter()
    with concurrent.futures.ThreadPoolExecutor(threads) as pool:
        logs = list(pool.map(LaneBlock.fly, ready))
    wall = time.perf_counter() - begin
    return sum(map(_flown_time, logs)) / wall


def _fly_on_core(lanes: Sequence[Lane]) -> float:
    """Simulated over processor time of a block."""
    block = LaneBlock(lanes)
    begin = time.thread_time()
    log = block.fly()
    return _flown_time(log) / (time.thread_time() - begin)


def _flown_time(log: Sequence[tuple[np.ndarray, object]]) -> float:
    """Simulated time of all lanes of a block [s]."""
    return sum(float(rows["time"][-1]) for rows, _ in log)


@jit(nogil=True)
def _call_often(rate, address, h, count):  # type: ignore[no-untyped-def]
    for _ in range(count):
        call_rate(rate, address, h)


def _time_arithmetic(lanes: Sequence[Lane]) -> float:
    """Simulated over processor time of a block that only calls the structure's function."""
    block, step = LaneBlock(lanes), lanes[0].timestep
    _call_often(block.rate.address, block.b.ctypes.data, step, 1)
    took = []
    for _ in range(3):
        begin = time.thread_time()
        _call_often(block.rate.address, block.b.ctypes.data, step, ALONE)
        took.append(time.thread_time() - begin)
    return ALONE * len(lanes) * step / min(took)
