"""Registry: control tasks by name; `register` adds your own.

A task is one file with a `GliderTask` and a function that makes its environment. The function takes
a vehicle first, then keyword arguments with defaults, which include `random` and
`environment_kwargs`. The first line of its docstring describes the task.
"""

from __future__ import annotations

import importlib.util
import inspect
from collections.abc import Callable
from typing import Any

from twin import seams
from twin.errors import InputError
from twin.registry import Registry

NEEDED = ("vehicle", "random", "environment_kwargs")
"""Arguments that `twin.control.load`, the viewer and Gymnasium's environments pass to a task."""
Maker = Callable[..., Any]
"""Function that makes the `twin.control.environment.Environment` of a task."""


def check_task(name: str, maker: Any) -> Maker:
    """Return the function if it is complete; raises InputError otherwise."""

    def half(what: str) -> InputError:
        return InputError(f"task {name!r} is only half there: {what}")

    if not (inspect.isfunction(maker) and maker.__name__ == name):
        raise half(f"{maker!r} must be a function of that name that makes its environment")
    if not inspect.getdoc(maker):
        raise half("its docstring must say what the task is")
    parameters = inspect.signature(maker).parameters
    lacking = [argument for argument in NEEDED if argument not in parameters]
    if lacking:
        raise half(f"it needs the arguments {', '.join(lacking)}")
    for parameter in parameters.values():
        if parameter.default is parameter.empty:
            raise half(f"its argument {parameter.name!r} needs a default")
    return maker


TASKS: Registry[Maker] = seams.TASKS
"""Functions that make the tasks, by name."""

ALL_TASKS = TASKS.shipped()
"""Names of the tasks that come with the package; `TASKS` also has registered ones."""

NAMESPACE = "glider_twin"
VERSION = 0
"""Version of the tasks in Gymnasium; it rises when rewards are no longer comparable."""


def task_arguments(task_name: str) -> list[str]:
    """Names of the arguments that `task_kwargs` of a task may contain.

    Raises:
      UnknownName: no task has that name.
    """
    parameters = inspect.signature(TASKS[task_name]).parameters
    return [name for name in parameters if name != "environment_kwargs"]


def environment_id(task: str) -> str:
    """Gymnasium's name of a task: `glider_twin/Depth-v0` for `depth`."""
    return f"{NAMESPACE}/{task.capitalize()}-v{VERSION}"


def register_environments() -> None:
    """Register every task with Gymnasium, for one vehicle and for many."""
    import gymnasium

    for task in TASKS.names():
        if environment_id(task) not in gymnasium.registry:
            gymnasium.register(
                environment_id(task),
                entry_point="twin.control.glider_env:GliderEnv",
                vector_entry_point="twin.control.vector_env:GliderVectorEnv",
                kwargs={"task": task},
            )


def register(maker: Maker) -> Maker:
    """Register a task of your own by its function's name, in Gymnasium too; raises InputError."""
    TASKS.add(maker)
    if importlib.util.find_spec("gymnasium") is not None:
        register_environments()
    return maker
