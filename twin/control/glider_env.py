"""Glider env: one task with one vehicle as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from twin.control.environment import SETTINGS, Environment, load_environment
from twin.control.observations import FLAT, Observed
from twin.control.registry import task_arguments
from twin.control.task import LARGEST_SEED, episode_random
from twin.errors import InputError, UnknownName, unknown_name

OWN = ("observation", "noise", "render_mode", "render_kwargs")
"""Arguments of `GliderEnv` itself."""
LOADS = ("random", "environment_kwargs", "task_kwargs")
"""Arguments of `twin.control.load` that `GliderEnv` takes in another form."""
VECTORS = ("engine", "threads", "autoreset_mode")
"""Arguments of `GliderVectorEnv` that do not apply to one vehicle."""
TAKEN = tuple(name for name in SETTINGS if name != "raise_on_instability")
"""Settings that go to the inner `Environment`; all other arguments go to the task."""
RENDER_MODES = ("rgb_array",)


def load_task(
    task: str, settings: Mapping[str, Any], own: Iterable[str], refused: Iterable[str] = ()
) -> Environment:
    """Make the inner `Environment` of a Gymnasium environment.

    Args:
      own: arguments of the Gymnasium environment itself, for error messages.
      refused: names in TAKEN that the Gymnasium environment refuses.

    Raises:
      InputError: an argument belongs to another interface; and the errors of `twin.control.load`.
      UnknownName: an unknown task or argument.
    """
    taken = {*task_arguments(task), *TAKEN}
    for name in settings:
        if name in LOADS:
            raise InputError(
                f"{name} is an argument of twin.control.load: here reset(seed=...) gives the "
                "random numbers, and everything else is an argument of its own"
            )
        if name in VECTORS and name not in taken:
            raise InputError(
                f"{name} is an option of gymnasium.make_vec only, of many vehicles: leave it out"
            )
        if name not in taken:
            allowed = (taken | set(own)) - {*LOADS, *refused}
            raise UnknownName(f"argument of task {task!r}", name, allowed)
    ours = {name: settings[name] for name in TAKEN if name in settings}
    others = {name: value for name, value in settings.items() if name not in ours}
    return load_environment(task, others, ours)


def action_space(environment: Environment) -> spaces.Space[Any]:
    """Box of the commands of the parts, from -1 to 1 or in their units."""
    low, high = environment.task.action_range()
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)


class GliderEnv(Observed, gymnasium.Env[Any, NDArray[np.float32]]):
    """Task with one vehicle, for Gymnasium.

    The time limit truncates an episode; the surface, the depth limit and instability terminate it.
    The k-th episode after `reset(seed=...)` is sampled from the seed and k alone.
    """

    metadata = {"render_modes": list(RENDER_MODES)}  # noqa: RUF012

    def __init__(
        self,
        task: str = "depth",
        *,
        observation: str = FLAT,
        noise: Mapping[str, float] | None = None,
        render_mode: str | None = None,
        render_kwargs: Mapping[str, Any] | None = None,
        **settings: Any,
    ):
        """Make the environment.

        Args:
          task: one of `twin.control.TASKS`.
          observation: "flat", one Box of numbers of order 1; or "dict", by name in SI units.
          noise: standard deviation of white noise, by name of the observation and in its unit; also
            of the heading [rad] and position [m] from which goals are computed; see `Noise`.
          render_mode: None or "rgb_array".
          render_kwargs: arguments of `twin.control.pictures.Pictures.draw`: height, width,
            camera_id, depth, segmentation, scene_option.
          settings: arguments of the task (vehicle, time_limit [s], normalised, hydrodynamics) and
            those in TAKEN.

        Raises:
          InputError: an unknown task, argument, observation or render mode.
        """
        if render_mode not in (None, *RENDER_MODES):
            raise InputError(unknown_name("render_mode", str(render_mode), RENDER_MODES))
        self.environment = load_task(task, settings, OWN)
        """Task and physics, step by step; `twin.control.policies.Autopilot` takes this object."""
        self.task: Any = self.environment.task
        """Task with its goal and measurements."""
        self.render_mode, self._render_kwargs = render_mode, dict(render_kwargs or {})
        self._render_kwargs.setdefault("camera_id", "chase")
        self.metadata = {
            **self.metadata,
            "render_fps": 1.0 / self.environment.control_timestep(),
        }
        self._observe(self.task, self.environment.reset(), observation, noise)
        self.observation_space = self._observations.space
        self.action_space = action_space(self.environment)
        self._seed: int | None = None
        self._episode, self._step = 0, 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode.

        Raises:
          InputError: an option is given; a single environment has none.
        """
        for name in options or {}:
            raise InputError(f"option {name!r} of reset: a single environment takes no options")
        super().reset(seed=seed)
        if seed is not None or self._seed is None:
            self._seed = int(self.np_random.integers(LARGEST_SEED)) if seed is None else seed
            self._episode = 0
        self.task.set_generator(episode_random(self._seed, self._episode))
        self._episode, self._step = self._episode + 1, 0
        return self._observations.show(self.environment.reset()), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Advance by one control period.

        Raises:
          InputError: no episode has started, the episode is over, or the action is invalid.
        """
        if self._seed is None:
            raise InputError("no episode has begun: call reset first")
        self._step = self.environment.count + 1
        done = self.environment.step(action)
        terminated = done.over and done.discount == 0.0
        shown = self._observations.show(done.observation)
        return shown, float(done.reward), terminated, done.over and not terminated, {}

    def _errors(self) -> dict[str, NDArray[np.float64]]:
        """Errors of the observation in progress, by name."""
        assert self._seed is not None
        key = np.array([self._seed]), np.array([self._episode]), np.array([self._step])
        return {name: error[0] for name, error in self._noise.draw(*key).items()}

    def render(self) -> NDArray[np.uint8] | None:
        """Picture, shape (height, width, 3), in the render mode "rgb_array"; else None."""
        if self.render_mode is None:
            return None
        return np.asarray(self.environment.physics.render(**self._render_kwargs))

    def close(self) -> None:
        """Release the renderer."""
        self.environment.physics.free()
