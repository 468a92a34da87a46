"""Registration: the suite's tasks by their Gymnasium names."""

from __future__ import annotations

import gymnasium

NAMESPACE = "glider_twin"
VERSION = 0
"""Of the tasks as Gymnasium counts them: it rises when rewards are not to be compared any more."""
TASKS = ("hold", "depth", "waypoints", "energy")
"""Those that come with the package; reading them off `twin.suite` would import dm_control."""


def environment_id(task: str) -> str:
    """`glider_twin/Depth-v0` of the task `depth`."""
    return f"{NAMESPACE}/{task.capitalize()}-v{VERSION}"


def register_environments() -> None:
    """Register every task of the suite, for one vehicle and for many."""
    for task in TASKS:
        if environment_id(task) not in gymnasium.registry:
            gymnasium.register(
                environment_id(task),
                entry_point="twin.gym.environment:GliderEnv",
                vector_entry_point="twin.gym.vector:GliderVectorEnv",
                kwargs={"task": task},
            )
