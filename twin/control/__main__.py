"""Program `python -m twin.control`: a task in dm_control's interactive viewer."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from typing import Annotated

import tyro

from twin.cli.console import Console
from twin.cli.program import Program, commands_of
from twin.control.policies import POLICIES, Flown, Policy
from twin.control.registry import TASKS
from twin.errors import InputError, unknown_name
from twin.show.render.context import NoScreen

KEYS = "Space starts and pauses, ] goes to the chase camera, = and - change the speed, F1 helps"
"""Keys of dm_control's viewer that a user needs; its free camera stays at the surface."""


@dataclass(frozen=True, kw_only=True)
class ViewTask:
    """Watch a policy fly a task; needs a screen."""

    task: Annotated[str, tyro.conf.arg(help=", ".join(TASKS))] = "hold"
    policy: Annotated[str, tyro.conf.arg(help=", ".join(POLICIES))] = "autopilot"
    vehicle: str = "glider"
    """shipped vehicle name or path of an MJCF file; :PRESET after it selects a preset"""
    seed: int = 0
    """seed of the task and of the random policy"""
    show_reward: bool = False
    """colour the hull by the reward"""

    def run(self, console: Console) -> int:
        """Open the window; return when it is closed."""
        from twin.control.dm_suite import load

        if self.policy not in POLICIES:
            raise InputError(unknown_name("policy", self.policy, POLICIES))
        environment = load(
            self.task,
            task_kwargs={"vehicle": self.vehicle, "random": self.seed},
            visualize_reward=self.show_reward,
        )
        console.note(KEYS)
        launch(environment, POLICIES[self.policy](environment, self.seed))
        return 0


def launch(environment: Flown, policy: Policy) -> None:
    """Show the environment in dm_control's viewer.

    Raises:
      NoScreen: no window system is there, or MUJOCO_GL selects drawing without a screen.
    """
    from dm_control import _render

    if _render.BACKEND != "glfw":
        chosen = os.environ.get("MUJOCO_GL") or "nothing"
        raise NoScreen(
            f"the viewer needs a screen, and here dm_control draws with {chosen}: run it on a "
            "desktop with MUJOCO_GL unset, or draw pictures with "
            "environment.physics.render(camera_id='chase')"
        )
    from dm_control import viewer  # its import warns without a screen

    viewer.launch(environment, policy=policy, title=f"glider: {type(environment.task).__name__}")


_VIEW = "view"
PROGRAM = Program(
    name="python -m twin.control",
    summary="Control tasks for a glider, in the dm_control viewer.",
    commands=commands_of(
        "twin.control",
        {_VIEW: ("__main__:ViewTask", "watch a policy fly a task (the default command)")},
    ),
)


def main() -> int:
    """Run the program; without a command, options go to `view`."""
    words = sys.argv[1:]
    if not words or (words[0].startswith("-") and words[0] not in ("-h", "--help", "--version")):
        words = [_VIEW, *words]
    return PROGRAM.main(words)


if __name__ == "__main__":
    sys.exit(main())
