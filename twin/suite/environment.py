"""Environment: dm_control's, except that an unstable simulation ends the episode."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import dm_env
import numpy as np
from dm_control.rl import control

from twin.errors import InputError
from twin.navigation.estimators.base import VelocityEstimator
from twin.navigation.settings import Navigation
from twin.numbers import number
from twin.suite.believed import Believed
from twin.suite.conditions import Randomiser, conditions_of
from twin.suite.physics import Physics
from twin.suite.task import GliderTask
from twin.water.current.base import Current


class Environment(control.Environment):
    """A task with a glider.

    When the state leaves the finite numbers, the episode ends with reward 0, discount 0 and the
    last finite observation, so that no NaN reaches a learner; with `raise_on_instability` the
    `PhysicsError` goes through instead.
    """

    def __init__(
        self,
        physics: Physics,
        task: GliderTask,
        *,
        raise_on_instability: bool = False,
        navigate: str | VelocityEstimator | Navigation | None = None,
        current: Current | str | None = None,
        randomise: Randomiser | str | Mapping[str, Any] | None = None,
        **settings: Any,
    ):
        """See `control.Environment` for the other settings.

        Args:
          navigate: what observations show, as `Scenario.navigate`: the truth, or what is known on
            board. Rewards and the ends of episodes go by the truth. A Navigation's own seed is not
            used: every episode draws one from the task's `random`.
          current: of the water, or its text as `twin simulate --current` takes it; it is added to
            what the task draws.
          randomise: what draws the errors of the vehicle and its water for every episode; see
            `twin.suite.conditions`.

        Raises:
          InputError: there is no such estimator, current or randomiser, or the episodes have no
            time limit.
        """
        navigation = Navigation.of(navigate)
        super().__init__(physics, task, **settings)
        task.period = self._n_sub_steps * physics.timestep()
        task.duration = self._step_limit * task.period
        task.conditions = conditions_of(
            current, randomise, vehicle=task.vehicle, depth=task.max_depth, duration=task.duration
        )
        task.believed = None
        if navigation is not None:
            if not np.isfinite(self._step_limit):
                raise InputError(
                    "a navigated environment needs a time limit: its sensors' errors are drawn "
                    "for an episode"
                )
            task.believed = Believed(
                task.vehicle,
                navigation,
                period=task.period,
                samples=int(self._step_limit) + 2,
            )
        self._believed = task.believed
        self._raise_on_instability = raise_on_instability
        self._last_observation: Mapping[str, Any] = {}

    def reset(self) -> dm_env.TimeStep:
        """Start a new episode."""
        if self._believed is not None:
            self._believed.restart(self.task.random)
        return self._remember(super().reset())

    def step(self, action: Any) -> dm_env.TimeStep:
        """Advance by one control timestep, or start a new episode after the last step of one."""
        try:
            return self._remember(super().step(action))
        except control.PhysicsError:
            if self._raise_on_instability:
                raise
        self._reset_next_step = True
        copies = {name: np.array(value) for name, value in self._last_observation.items()}
        observation = type(self._last_observation)(copies)  # type: ignore[call-arg]
        return dm_env.TimeStep(dm_env.StepType.LAST, 0.0, 0.0, observation)

    def _remember(self, time_step: dm_env.TimeStep) -> dm_env.TimeStep:
        self._last_observation = time_step.observation
        return time_step


def build(
    physics: Physics,
    task: GliderTask,
    *,
    time_limit: float,
    settings: Mapping[str, Any] | None,
) -> Environment:
    """The environment of a task: control timestep of the vehicle unless `settings` says otherwise.

    Args:
      time_limit: [s] of an episode.
      settings: the caller's `environment_kwargs`.

    Raises:
      InputError: an impossible time limit or control timestep.
    """
    time_limit = number(time_limit, "time_limit")
    if not time_limit > 0:
        raise InputError(f"time_limit {time_limit} s must be positive (float('inf') for none)")
    chosen = dict(settings or {})
    if "n_sub_steps" not in chosen:
        chosen.setdefault("control_timestep", task.vehicle.control_period)
        _check_period(chosen["control_timestep"], physics.timestep())
    return Environment(physics, task, time_limit=time_limit, **chosen)


def _check_period(period: object, step: float) -> None:
    """Refuse a control timestep that is not a whole number of steps of the physics [s]."""
    asked = number(period, "control_timestep")
    steps = round(asked / step) if math.isfinite(asked) else 0
    if steps < 1 or not math.isclose(steps * step, asked, rel_tol=1e-9):
        nearest = max(1, steps) * step
        raise InputError(
            f"control_timestep is {asked:g} s: it must be a whole number of the physics' steps of "
            f"{step:g} s, such as {nearest:g} s"
        )
