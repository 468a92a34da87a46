"""Suite step: cost of an environment step [us] and of its bare physics.

    python -m benchmarks.suite_step [--rewards]

With --rewards it prints the mean rewards of the suite's policies instead.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable

import mujoco
import numpy as np

from benchmarks.figures import seconds
from twin import control
from twin.control.policies import POLICIES

STEPS = 400
REPEATS = 9
EPISODES = 20
YARDSTICKS = (("fish", "swim"), ("swimmer", "swimmer6"))


def median_cost(step: Callable[[], object]) -> float:
    """[us] Median time of a call."""

    def steps() -> None:
        for _ in range(STEPS):
            step()

    return 1e6 * statistics.median(seconds(steps) for _ in range(REPEATS)) / STEPS


def costs() -> None:
    print(f"{'task':24s} {'step':>8s} {'physics':>8s}  substeps")
    for task in control.ALL_TASKS:
        environment = control.load(task, task_kwargs={"random": 0, "time_limit": float("inf")})
        report(task, environment, environment.task.to_action(environment.physics.control()))
    from dm_control import suite as dm_suite  # after ours, which choose how it draws

    for domain, task in YARDSTICKS:
        environment = dm_suite.load(domain, task, task_kwargs={"random": 0})
        report(f"dm_control {domain}", environment, np.zeros(environment.action_spec().shape))


def report(name: str, environment, action) -> None:
    environment.reset()
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    substeps = round(environment.control_timestep() / environment.physics.timestep())
    whole = median_cost(lambda: environment.step(action))
    environment.reset()
    bare = median_cost(lambda: mujoco.mj_step(model, data, nstep=substeps))
    print(f"{name:24s} {whole:8.1f} {bare:8.1f}  {substeps}")


def rewards() -> None:
    print(f"| mean reward | {' | '.join(f'`{task}`' for task in control.ALL_TASKS)} |")
    for name in POLICIES:
        cells = []
        for task in control.ALL_TASKS:
            means = [episode(task, name, seed) for seed in range(EPISODES)]
            cells.append(f"{statistics.mean(means):.2f}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def episode(task: str, policy: str, seed: int) -> float:
    """Mean reward over an episode's full length; after an early end, rewards count as 0."""
    environment = control.load(task, task_kwargs={"random": seed})
    pilot = POLICIES[policy](environment, seed)
    time_step, total = environment.reset(), 0.0
    while not time_step.last():
        time_step = environment.step(pilot(time_step))
        total += time_step.reward
    return total / environment.own.limit


if __name__ == "__main__":
    rewards() if "--rewards" in sys.argv[1:] else costs()
