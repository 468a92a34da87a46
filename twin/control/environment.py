"""Environment: episodes of a task with one vehicle, step by step.

The interfaces are built on it: `twin.control.dm_suite` for dm_control, and
`twin.control.glider_env` for Gymnasium.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from twin.control.believed import Believed
from twin.control.conditions import Randomiser, conditions_of
from twin.control.physics import Physics
from twin.control.registry import TASKS, task_arguments
from twin.control.task import GliderTask, Observation
from twin.errors import InputError, UnknownName
from twin.navigation.estimators.base import VelocityEstimator
from twin.navigation.settings import Navigation
from twin.numbers import number
from twin.water.current.base import Current


class Step(NamedTuple):
    """Result of one control period."""

    observation: Observation
    reward: float
    discount: float
    """Discount: 0 if the vehicle was lost, 1 otherwise."""
    over: bool
    """True if this was the last step of the episode."""


class Environment:
    """Task with one vehicle.

    If the state is no longer finite, the episode ends with reward 0, discount 0 and the last finite
    observation, so that no NaN reaches a learner. With `raise_on_instability` the error of the
    physics is raised instead.
    """

    def __init__(
        self,
        physics: Physics,
        task: GliderTask,
        *,
        time_limit: float = math.inf,
        substeps: int = 1,
        raise_on_instability: bool = False,
        navigate: str | VelocityEstimator | Navigation | None = None,
        current: Current | str | None = None,
        randomise: Randomiser | str | Mapping[str, Any] | None = None,
    ):
        """Set up a task with its physics, water and navigation.

        Args:
          time_limit: longest duration of an episode [s].
          substeps: physics steps in a control period.
          navigate: source of observations, as in `Scenario.navigate`: the truth, or an estimate on
            board. Rewards and ends of episodes use the truth. The seed of a Navigation is ignored:
            every episode samples one from the task's `random`.
          current: current of the water, or its text as for `twin simulate --current`; it is added
            to the current that the task samples.
          randomise: sampler of the vehicle's errors and the water of every episode; see
            `twin.control.conditions`.

        Raises:
          InputError: an unknown estimator, current or randomiser; or episodes without the time
            limit that these need.
        """
        navigation = Navigation.of(navigate)
        self.physics, self.task, self.substeps = physics, task, substeps
        self.limit = math.inf
        """Control periods in an episode, not necessarily a whole number."""
        if time_limit != math.inf:
            self.limit = time_limit / (physics.timestep() * substeps)
        self.count = 0
        """Steps since the last reset."""
        self.over = True
        """True if a reset must come next."""
        task.period = substeps * physics.timestep()
        task.duration = self.limit * task.period
        task.conditions = conditions_of(
            current, randomise, vehicle=task.vehicle, depth=task.max_depth, duration=task.duration
        )
        task.believed = None
        if navigation is not None:
            if not np.isfinite(self.limit):
                raise InputError(
                    "a navigated environment needs a time limit: its sensors' errors are drawn "
                    "for an episode"
                )
            task.believed = Believed(
                task.vehicle,
                navigation,
                period=task.period,
                samples=int(self.limit) + 2,
            )
        self._raise_on_instability = raise_on_instability
        self._last: Observation = Observation()

    def control_timestep(self) -> float:
        """Duration of a control period [s]."""
        return self.physics.timestep() * self.substeps

    def reset(self) -> Observation:
        """Start an episode; return its first observation."""
        task, physics = self.task, self.physics
        if task.believed is not None:
            task.believed.restart(task.random)
        self.over, self.count = False, 0
        with physics.reset_context():
            task.initialize_episode(physics)
        self._last = task.get_observation(physics)
        return self._last

    def step(self, action: Any) -> Step:
        """Advance by one control period.

        Raises:
          InputError: no episode has started, the episode is over, or the action is invalid.
        """
        if self.over:
            raise InputError("no episode is under way: call reset first")
        task, physics = self.task, self.physics
        try:
            task.before_step(action, physics)
            physics.step(self.substeps)
            task.after_step(physics)
            reward = task.get_reward(physics)
            self._last = task.get_observation(physics)
        except physics.unstable:
            if self._raise_on_instability:
                raise
            self.over = True
            copies = Observation((name, np.array(value)) for name, value in self._last.items())
            return Step(copies, 0.0, 0.0, True)
        self.count += 1
        discount = 1.0 if self.count >= self.limit else task.get_termination(physics)
        self.over = discount is not None
        return Step(self._last, reward, 1.0 if discount is None else discount, self.over)


def build(
    physics: Physics,
    task: GliderTask,
    *,
    time_limit: float,
    settings: Mapping[str, Any] | None,
) -> Environment:
    """Make a task's environment; its control period is the vehicle's unless `settings` has one.

    Args:
      time_limit: longest duration of an episode [s].
      settings: the caller's `environment_kwargs`: arguments of `Environment`, and
        control_timestep [s] or n_sub_steps, the number of physics steps.

    Raises:
      InputError: an impossible time limit or control timestep.
      UnknownName: a setting has an unknown name.
    """
    time_limit = number(time_limit, "time_limit")
    if not time_limit > 0:
        raise InputError(f"time_limit {time_limit} s must be positive (float('inf') for none)")
    chosen = dict(settings or {})
    for name in chosen:
        if name not in SETTINGS:
            raise UnknownName("environment setting", name, SETTINGS)
    if "n_sub_steps" in chosen:
        if "control_timestep" in chosen:
            raise InputError("n_sub_steps and control_timestep say the same: give one of them")
        substeps = chosen.pop("n_sub_steps")
        if not (isinstance(substeps, int | np.integer) and substeps > 0):
            raise InputError(f"n_sub_steps is {substeps!r}: give a whole number of 1 or more")
    else:
        period = chosen.pop("control_timestep", task.vehicle.control_period)
        substeps = _substeps(period, physics.timestep())
    return Environment(physics, task, time_limit=time_limit, substeps=int(substeps), **chosen)


SETTINGS = (
    "control_timestep",
    "n_sub_steps",
    "navigate",
    "randomise",
    "current",
    "raise_on_instability",
)
"""Names that `build` accepts in `settings`."""


def _substeps(period: object, step: float) -> int:
    """Number of physics steps in a control period, which must be a whole number."""
    asked = number(period, "control_timestep")
    steps = round(asked / step) if math.isfinite(asked) else 0
    if steps < 1 or not math.isclose(steps * step, asked, rel_tol=1e-9):
        nearest = max(1, steps) * step
        raise InputError(
            f"control_timestep is {asked:g} s: it must be a whole number of the physics' steps of "
            f"{step:g} s, such as {nearest:g} s"
        )
    return steps


def load_environment(
    task_name: str,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
) -> Environment:
    """Make the environment of a task by name, on the project's own physics.

    Args:
      task_name: one of `twin.control.TASKS`.
      task_kwargs, environment_kwargs: as for `twin.control.load`.

    Raises:
      InputError: unknown task or argument; and the errors of vehicle and task.
    """
    maker = TASKS[task_name]
    allowed = task_arguments(task_name)
    for name in task_kwargs or {}:
        if name not in allowed:
            raise UnknownName(f"argument of task {task_name!r}", name, allowed)
    environment = maker(**(task_kwargs or {}), environment_kwargs=environment_kwargs)
    if not isinstance(environment, Environment):
        raise InputError(
            f"task {task_name!r} made {environment!r}: return twin.control.environment.build(...)"
        )
    return environment
