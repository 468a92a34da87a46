"""Environment steps per second with many vehicles at once, beside what bounds them.

    python -m benchmarks.vector_env [--vehicles N]

The limit is bare `mujoco.batch` on the same threads: the same models and control period, without
observations, rewards and ends. The single environment stands beside it. The three are measured in
turn; each figure is the median over the rounds.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import gymnasium
import numpy as np

from benchmarks.figures import measured
from twin.control import ALL_TASKS, GliderVectorEnv
from twin.control.registry import environment_id

ROUNDS = 7
SECONDS = 0.35
"""[s] of each measurement"""


def rate(step: Callable[[], object], per_call: int) -> float:
    """Environment steps per second."""
    calls, begin = 0, time.perf_counter()
    while (passed := time.perf_counter() - begin) < SECONDS:
        step()
        calls += 1
    return calls * per_call / passed


def measure(task: str, vehicles: int) -> tuple[float, float, float]:
    """Vector environment, bare batch and single environment [steps per second]."""
    many = gymnasium.make_vec(environment_id(task), num_envs=vehicles)
    one = gymnasium.make(environment_id(task)).unwrapped
    assert isinstance(many, GliderVectorEnv)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (16, vehicles, 3)).astype(np.float32)
    many.reset(seed=0), one.reset(seed=0)
    turn = iter(range(10**9))
    batch, substeps = many.physics.batch, many.substeps

    def single() -> None:
        over = one.step(actions[next(turn) % 16, 0])[2:4]
        if any(over):
            one.reset()

    rates: list[list[float]] = [[], [], []]
    for _ in range(ROUNDS):
        rates[0].append(rate(lambda: many.step(actions[next(turn) % 16]), vehicles))
        rates[1].append(rate(lambda: batch.step(nstep=substeps), vehicles))
        rates[2].append(rate(single, 1))
    first, second, third = (statistics.median(values) for values in rates)
    return first, second, third


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--vehicles", type=int, default=512)
    vehicles = parser.parse_args().vehicles
    print(f"environment steps per second, {vehicles} vehicles, control period 0.5 s")
    print(
        f"{'task':12s} {'vector':>9s} {'bare batch':>11s} {'part':>6s} {'single':>8s} {'times':>6s}"
    )
    found = []
    for task in ALL_TASKS:
        vector, bare, single = measure(task, vehicles)
        found.append((vector, vector / bare, vector / single))
        print(
            f"{task:12s} {vector:9.0f} {bare:11.0f} {vector / bare:6.2f} {single:8.0f} "
            f"{vector / single:6.1f}"
        )
    steps, part, times = (list(column) for column in zip(*found, strict=True))
    measured("vector_env", steps=steps, part=part, times=times)


if __name__ == "__main__":
    main()
