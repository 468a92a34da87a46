"""Vector environment: environment steps per second with many vehicles, against their limits.

    python -m benchmarks.vector_env [--vehicles N] [--lanes M]

The limit is bare `mujoco.batch` on the same threads: the same models and control period, without
observations, rewards and ends. The single environment and the vector environment with
engine="lanes" and M vehicles are measured too. The four take turns; each figure is the median over
the rounds. Wall time says little on a shared machine. The last column is the processor time [us] of
a step with lanes, over all threads.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial

import gymnasium
import numpy as np

from benchmarks import command
from benchmarks.figures import measured, medians
from twin.control.registry import environment_id

TASKS = ("hold", "depth", "waypoints", "energy")
"""Tasks of a glider, with its control period"""
ROUNDS = 7
SECONDS = 0.35
"""[s] Duration of each measurement"""


def rate(
    step: Callable[[], object], per_call: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Environment steps per second of wall time."""
    calls, begin, processor = 0, time.perf_counter(), clock()
    while time.perf_counter() - begin < SECONDS:
        step()
        calls += 1
    return calls * per_call / (clock() - processor)


def measure(task: str, vehicles: int, lanes: int) -> dict[str, float]:
    """Steps per second of vector environment, bare batch and single environment, and of lanes by
    wall and by processor time."""
    many = gymnasium.make_vec(environment_id(task), num_envs=vehicles)
    one = gymnasium.make(environment_id(task)).unwrapped
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (16, vehicles, 3)).astype(np.float32)
    fossen = gymnasium.make_vec(environment_id(task), num_envs=lanes, engine="lanes")
    commands = rng.uniform(-1.0, 1.0, (16, lanes, 3)).astype(np.float32)
    many.reset(seed=0), one.reset(seed=0), fossen.reset(seed=0)
    fossen.step(commands[0])  # compiles
    turn = iter(range(10**9))
    batch, substeps = many.physics.batch, many.substeps

    def single() -> None:
        over = one.step(actions[next(turn) % 16, 0])[2:4]
        if any(over):
            one.reset()

    def in_lanes() -> None:
        fossen.step(commands[next(turn) % 16])

    clocks = {
        "vector": partial(rate, lambda: many.step(actions[next(turn) % 16]), vehicles),
        "bare": partial(rate, lambda: batch.step(nstep=substeps), vehicles),
        "single": partial(rate, single, 1),
        "lanes": partial(rate, in_lanes, lanes),
        "processor": partial(rate, in_lanes, lanes, time.process_time),
    }
    return medians(clocks, ROUNDS)


def main(*, vehicles: int = 512, lanes: int = 4096) -> None:
    """Print a row for each task."""
    print(
        f"environment steps per second, {vehicles} vehicles, {lanes} in lanes, control period 0.5 s"
    )
    print(
        f"{'task':12s} {'vector':>9s} {'bare batch':>11s} {'part':>6s} {'single':>8s} "
        f"{'times':>6s} {'lanes':>9s} {'us':>6s}"
    )
    found = []
    for task in TASKS:
        one = measure(task, vehicles, lanes)
        vector, part, times = (one["vector"] / by for by in (1.0, one["bare"], one["single"]))
        found.append((vector, part, times, one["lanes"]))
        print(
            f"{task:12s} {vector:9.0f} {one['bare']:11.0f} {part:6.2f} {one['single']:8.0f} "
            f"{times:6.1f} {one['lanes']:9.0f} {1e6 / one['processor']:6.2f}"
        )
    steps, parts, ratios, in_lanes = (list(column) for column in zip(*found, strict=True))
    measured("vector_env", steps=steps, part=parts, times=ratios, lanes=in_lanes)


if __name__ == "__main__":
    sys.exit(command.run(main))
