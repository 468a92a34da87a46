"""Loader: an environment by the name of its task."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from twin.errors import InputError, UnknownName
from twin.suite.environment import Environment
from twin.suite.registry import TASKS

ALL_TASKS = TASKS.shipped()
"""Names of the tasks that come with the package; `twin.suite.TASKS` has registered ones too."""
_OWN_ARGUMENTS = ("environment_kwargs",)


def task_arguments(task_name: str) -> list[str]:
    """Names of what `task_kwargs` of a task takes.

    Raises:
      UnknownName: there is no such task.
    """
    parameters = inspect.signature(TASKS[task_name]).parameters
    return [name for name in parameters if name not in _OWN_ARGUMENTS]


def load(
    task_name: str,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    visualize_reward: bool = False,
) -> Environment:
    """The environment of a task.

    Args:
      task_name: one of TASKS.
      task_kwargs: vehicle (name or path), random (seed or RandomState), time_limit [s],
        normalised (actions from -1 to 1), hydrodynamics; `energy` also takes consumption.
      environment_kwargs: of `twin.suite.environment.Environment`, e.g. flat_observation,
        control_timestep [s], raise_on_instability.
      visualize_reward: colour the hull by the reward.

    Raises:
      InputError: unknown task or argument; and what vehicle and task raise.
    """
    maker = TASKS[task_name]
    allowed = task_arguments(task_name)
    for name in task_kwargs or {}:
        if name not in allowed:
            raise UnknownName(f"argument of task {task_name!r}", name, allowed)
    environment = maker(**(task_kwargs or {}), environment_kwargs=environment_kwargs)
    if not isinstance(environment, Environment):
        raise InputError(
            f"task {task_name!r} made {environment!r}: return twin.suite.environment.build(...)"
        )
    environment.task.visualize_reward = visualize_reward
    return environment
