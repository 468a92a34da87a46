"""Loader: an environment by the name of its task."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from twin.errors import InputError, unknown_name
from twin.suite.depth import depth
from twin.suite.energy import energy
from twin.suite.environment import Environment
from twin.suite.hold import hold
from twin.suite.waypoints import waypoints

_MAKERS: dict[str, Callable[..., Environment]] = {
    "hold": hold,
    "depth": depth,
    "waypoints": waypoints,
    "energy": energy,
}
ALL_TASKS = tuple(_MAKERS)
"""Names of the tasks."""
_OWN_ARGUMENTS = ("environment_kwargs",)


def load(
    task_name: str,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    visualize_reward: bool = False,
) -> Environment:
    """The environment of a task.

    Args:
      task_name: one of ALL_TASKS.
      task_kwargs: vehicle (name or path), random (seed or RandomState), time_limit [s],
        normalised (actions from -1 to 1), hydrodynamics; `energy` also takes consumption.
      environment_kwargs: of `twin.suite.environment.Environment`, e.g. flat_observation,
        control_timestep [s], raise_on_instability.
      visualize_reward: colour the hull by the reward.

    Raises:
      InputError: unknown task or argument; and what vehicle and task raise.
    """
    if task_name not in _MAKERS:
        raise InputError(unknown_name("task", task_name, ALL_TASKS))
    maker = _MAKERS[task_name]
    allowed = [name for name in inspect.signature(maker).parameters if name not in _OWN_ARGUMENTS]
    for name in task_kwargs or {}:
        if name not in allowed:
            raise InputError(unknown_name(f"argument of task {task_name!r}", name, allowed))
    environment = maker(**(task_kwargs or {}), environment_kwargs=environment_kwargs)
    environment.task.visualize_reward = visualize_reward
    return environment
