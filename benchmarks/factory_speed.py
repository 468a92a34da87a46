"""Factory speed: speed, memory and store size, compared with bare MuJoCo and other yardsticks.

    python -m benchmarks.factory_speed [HOURS] [--json]
    python -m benchmarks.factory_speed --vehicles [--json]    # the glider and Tethys alone

HOURS is the length of the long run, 100 by default; the project's promise is for 1000. Each row
gives simulated time over elapsed time, and over CPU time, with its ratio to bare MuJoCo's. The
bare step has the same model without water, guidance, log, sensors, compression and files. On a
shared machine, only CPU time and the ratio are meaningful.

The rate of a propelled vehicle's surveys is measured in alternation with the glider's, and is the
best of PAIRS each, so that both see the same load of the machine.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import mujoco
import numpy as np

from benchmarks import command
from benchmarks.figures import measured
from benchmarks.processes import ran
from factory.sampling.recipe import make_recipe
from twin.fossen import FossenModel, FossenState
from twin.mission import Mission, SawTooth
from twin.mission.controller import Schedule
from twin.physics.mujoco_model import compile_model
from twin.physics.native.install import install, stop_timers, uninstall
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.records.storage import files_at
from twin.vehicle.vehicle import load_vehicle

CPUS = len(os.sched_getaffinity(0))
SHORT_HOURS = 10.0
WALL_LIMIT_S, RATE_LIMIT, MEMORY_LIMIT = 4.0, 25_000.0, 1e9
"""Promises on 2 CPUs: [s] for 10 h cold, [1] sustained rate over 1000 h, [bytes] memory."""
VEHICLES, PAIRS, VEHICLE_LIMIT = ("glider", "tethys"), 3, 1.0 / 3.0
"""Tethys must fly at this fraction of the glider's rate or faster, 10 h each"""
BARE_STEPS, PYTHON_STEPS = 200_000, 5_000
FOSSEN_SECONDS = 600.0


def rates(work: Callable[[], object], seconds: float) -> tuple[float, float]:
    """Speed of simulating `seconds` [s]: relative to elapsed time and to CPU time."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return seconds / (time.perf_counter() - wall), seconds / (time.process_time() - cpu)


def bare_step() -> tuple[float, float]:
    """Measure MuJoCo's step alone, without its timers' clock."""
    model = compile_model(lean=True)
    uninstall()
    stop_timers()
    try:
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=1000)
        mujoco.mj_resetData(model, data)
        step = partial(mujoco.mj_step, model, data, nstep=BARE_STEPS)
        return rates(step, BARE_STEPS * model.opt.timestep)
    finally:
        install()


def native_step() -> tuple[float, float]:
    """Measure the step with our water, guidance and log."""
    mission = Mission(
        segments=(SawTooth(max_depth_m=100.0, heading_deg=30.0),),
        duration_s=BARE_STEPS * 0.1,
        at_end="hold",
    )
    simulation = Simulation(Scenario(mission=mission))
    return rates(simulation.run, simulation.duration)


def python_callback() -> tuple[float, float]:
    """Measure a Python loop around mj_step with the water in a Python callback, a common design."""
    vehicle = load_vehicle()
    model = compile_model(vehicle, lean=True)
    uninstall()
    hull = model.body("hull").id
    k_d0, k_d = vehicle.flow_frame.drag
    k_l0, k_alpha = vehicle.flow_frame.lift
    k_m0, k_m, k_q = vehicle.flow_frame.pitch_moment

    def water(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        rotation = data.xmat[hull].reshape(3, 3)
        u, v, w = rotation.T @ data.qvel[:3] * [1.0, -1.0, -1.0]
        p, q, r = data.qvel[3:6] * [1.0, -1.0, -1.0]
        speed = u * u + v * v + w * w
        alpha, beta = np.arctan2(w, u), np.arcsin(np.clip(v / np.sqrt(speed + 1e-12), -1, 1))
        drag, lift = (k_d0 + k_d * alpha**2) * speed, (k_l0 + k_alpha * alpha) * speed
        force = np.array([
            -drag * np.cos(alpha) + lift * np.sin(alpha),
            vehicle.flow_frame.side_force[0] * beta * speed,
            -drag * np.sin(alpha) - lift * np.cos(alpha),
        ])  # fmt: skip
        moment = speed * np.array([
            vehicle.flow_frame.roll_moment[0] * beta + vehicle.flow_frame.roll_moment[1] * p,
            k_m0 + k_m * alpha + k_q * q,
            vehicle.flow_frame.yaw_moment[0] * beta + vehicle.flow_frame.yaw_moment[1] * r,
        ])  # fmt: skip
        data.xfrc_applied[hull, :3] = rotation @ (force * [1.0, -1.0, -1.0])
        data.xfrc_applied[hull, 2] += (vehicle.mass - 0.3) * vehicle.gravity
        data.xfrc_applied[hull, 3:] = rotation @ (moment * [1.0, -1.0, -1.0])

    mujoco.set_mjcb_passive(water)
    try:
        model.opt.timestep = 0.01  # without added mass in the mass matrix 0.1 s is unstable
        data = mujoco.MjData(model)

        def steps() -> list[np.ndarray]:
            rows = []
            for step in range(PYTHON_STEPS):
                mujoco.mj_step(model, data)
                if step % 50 == 0:
                    rows.append(np.concatenate([data.qpos, data.qvel]))
            return rows

        return rates(steps, PYTHON_STEPS * model.opt.timestep)
    finally:
        mujoco.set_mjcb_passive(None)
        install()


def fossen(seconds: float) -> tuple[float, float]:
    """Measure the independent Fossen model on one dive, compiled beforehand."""
    vehicle = load_vehicle()
    model = FossenModel(vehicle)
    pump = vehicle.pump_for_net_mass(0.3)
    schedule = Schedule(times=[0.0], commands=[[0.02, 0.0, pump]])
    start = FossenState(position_ned=(0.0, 0.0, 10.0))
    model.simulate(start, schedule, 5.0)
    return rates(partial(model.simulate, start, schedule, seconds), seconds)


def generate(hours: float, preset: str, folder: Path, vehicle: str = "glider") -> dict[str, float]:
    """Run a cold `factory generate`: wall and CPU time [s], peak memory and store size [bytes]."""
    store = folder / f"{preset}-{vehicle}-{hours:g}.zarr"
    words = [sys.executable, "-m", "factory", "generate", "--hours", str(hours)]
    words += ["--preset", preset, "--vehicle", vehicle, "--out", str(store), "--overwrite"]
    used = ran(words)
    size = files_at(store).stored_bytes()
    shutil.rmtree(store)
    return {
        "wall_s": used.wall_s, "cpu_s": used.cpu_s, "memory": float(used.memory_of_all),
        "bytes": float(size),
    }  # fmt: skip


def beside_the_glider(folder: Path) -> list[dict[str, object]]:
    """Row of each vehicle: its best rates of 10 h and their ratios to the glider's."""
    runs: dict[str, list[dict[str, float]]] = {vehicle: [] for vehicle in VEHICLES}
    for turn in range(PAIRS + 1):
        for vehicle in VEHICLES:
            run = generate(SHORT_HOURS, "paper", folder, vehicle)
            if turn:  # the first run compiles
                runs[vehicle].append(run)
    best = {
        (vehicle, time): SHORT_HOURS * 3600.0 / min(run[time] for run in runs[vehicle])
        for vehicle in VEHICLES
        for time in ("wall_s", "cpu_s")
    }
    glider = VEHICLES[0]
    return [
        {
            "vehicle": vehicle, "times real time": round(best[vehicle, "wall_s"]),
            "of the glider": best[vehicle, "wall_s"] / best[glider, "wall_s"],
            "per CPU": round(best[vehicle, "cpu_s"]),
            "per CPU, of the glider": best[vehicle, "cpu_s"] / best[glider, "cpu_s"],
        }
        for vehicle in VEHICLES
    ]  # fmt: skip


def main(
    hours: command.Positional[float] = 100.0, *, vehicles: bool = False, json: bool = False
) -> int:
    """Print the tables, with exit code 1 if a promise is broken.

    Args:
      hours: length of the long run.
      vehicles: the glider and Tethys alone.
    """
    found: dict[str, Any] = {}
    promises: dict[str, bool] = {}
    with tempfile.TemporaryDirectory() as folder:
        if not vehicles:
            found["speed"], found["store"], promises = factory_alone(hours, Path(folder))
        rows = found["vehicles"] = beside_the_glider(Path(folder))
    kept = min(float(str(rows[-1][name])) for name in ("of the glider", "per CPU, of the glider"))
    promises[f"{VEHICLES[-1]} at {VEHICLE_LIMIT:.2f} of the glider's rate"] = kept >= VEHICLE_LIMIT
    command.say({**found, "promises": promises}, *found.values(), json=json)
    if not json:
        for promise, is_kept in promises.items():
            print(f"{promise}: {'kept' if is_kept else 'NOT kept'} (on {CPUS} CPUs)")
    return 0 if all(promises.values()) else 1


def factory_alone(hours: float, folder: Path) -> tuple[list[Any], list[Any], dict[str, bool]]:
    """Rows of speeds and of stores, and whether each promise is kept."""
    bare = bare_step()
    rows: list[dict[str, object]] = []

    def add(what: str, cpus: int, rates: tuple[float, float]) -> None:
        wall, cpu = rates
        rows.append({
            "what": what, "CPUs": cpus, "times real time": round(wall),
            "per CPU": round(cpu), "of the bare step": cpu / bare[1],
        })  # fmt: skip

    add("bare MuJoCo step", 1, bare)
    add("with water, guidance and log", 1, native_step())
    add("Python loop, Python callback", 1, python_callback())
    add("Fossen model, own RK4", 1, fossen(FOSSEN_SECONDS))
    generate(SHORT_HOURS, "paper", folder)  # compiled code is in its cache afterwards
    runs, stores = [], []
    for preset, length in (("paper", SHORT_HOURS), ("paper", hours), ("field", hours)):
        run = generate(length, preset, folder)
        runs.append(run)
        name, seconds = f"factory, {preset}, {length:g} h, cold process", length * 3600.0
        add(name, CPUS, (seconds / run["wall_s"], seconds / run["cpu_s"]))
        raw = make_recipe(preset=preset, hours=length).float32_bytes
        stores.append({
            "what": name, "wall [s]": run["wall_s"], "CPU [s/h]": run["cpu_s"] / length,
            "peak memory [MB]": run["memory"] / 1e6, "MB per hour": run["bytes"] / 1e6 / length,
            "of float32": run["bytes"] / raw,
        })  # fmt: skip
    first, long, _ = runs
    per_cpu = 3600.0 * hours / long["cpu_s"]
    measured("factory_speed", short_s=first["wall_s"], per_cpu=per_cpu, of_bare=per_cpu / bare[1])
    return rows, stores, {
        f"{SHORT_HOURS:g} h within {WALL_LIMIT_S:g} s": first["wall_s"] <= WALL_LIMIT_S,
        f"{hours:g} h at {RATE_LIMIT:,.0f} times real time":
            hours * 3600.0 / long["wall_s"] >= RATE_LIMIT,
        "memory under 1 GB": long["memory"] <= MEMORY_LIMIT,
    }  # fmt: skip


if __name__ == "__main__":
    sys.exit(command.run(main))
