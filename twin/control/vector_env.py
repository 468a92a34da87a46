"""Vector env: one task with many vehicles at once, stepped natively on every core.

Observations, rewards and ends are arrays. In a step, Python loops only over the few vehicles whose
episode starts or whose waypoint is reached. Vehicle i of `reset(seed=s)` flies the episodes of the
single environment after `reset(seed=s + i)`, with the same observations and rewards to rounding,
whatever the other vehicles do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from twin.control.environment import Environment
from twin.control.glider_env import action_space, load_task
from twin.control.many import ManyPhysics
from twin.control.many_lanes import ManyLanes
from twin.control.observations import FLAT, Observed
from twin.control.physics import ROOM
from twin.control.task import LARGEST_SEED, episode_random
from twin.errors import InputError, unknown_name
from twin.physics.mujoco_model import compile_model, with_hydrodynamics
from twin.physics.scenario import ENGINES

SMALL_ROOM = 64
"""Count of numbers of a task's own current that fit each vehicle's copy of the parameter block."""
OWN = ("num_envs", "engine", "observation", "noise", "autoreset_mode", "threads")
"""Arguments of `GliderVectorEnv` itself."""
AUTORESET = {mode.name.lower(): mode for mode in AutoresetMode}
Mask = NDArray[np.bool_]
Many = ManyPhysics | ManyLanes


def _make_physics(one: Environment, law: str, count: int, threads: int) -> ManyPhysics:
    varied = one.task.conditions is not None
    model = compile_model(
        one.task.vehicle,
        hydrodynamics=law,
        lean=True,
        centred=True,
        reserve=ROOM if varied else SMALL_ROOM,
    )
    return ManyPhysics(model, count, threads=threads, real_vehicles=varied)


def _make_lanes(one: Environment, law: str, count: int, threads: int) -> ManyLanes:
    vehicle = with_hydrodynamics(one.task.vehicle, law)
    return ManyLanes(vehicle, count, timestep=one.physics.timestep(), threads=threads)


class GliderVectorEnv(Observed, VectorEnv[Any, NDArray[np.float32], NDArray[Any]]):
    """Task with `num_envs` vehicles, for Gymnasium.

    `metadata["autoreset_mode"]` is the action after the end of an episode, as in Gymnasium. In
    `next_step` (default) the next step ignores the action and starts an episode with reward 0. In
    `same_step` the same step returns the first observation of the next episode, and
    `info["final_obs"]` the last one of the old. With `disabled` the caller resets, by
    `reset(options={"reset_mask": ended})`.
    """

    def __init__(
        self,
        task: str = "depth",
        num_envs: int = 1,
        *,
        engine: str = "mujoco",
        observation: str = FLAT,
        noise: Mapping[str, float] | None = None,
        autoreset_mode: str | AutoresetMode = "next_step",
        threads: int = 0,
        render_mode: str | None = None,
        **settings: Any,
    ):
        """Make the environment.

        Args:
          task: one of `twin.control.TASKS`.
          num_envs: number of vehicles.
          engine: "mujoco", or "lanes" (`twin.control.many_lanes`), which is much faster.
          observation: "flat" or "dict", as in `GliderEnv`.
          noise: standard deviations of white noise, as in `GliderEnv`.
          autoreset_mode: next_step, same_step or disabled.
          threads: number of threads, 0 takes every core. Results do not depend on it.
          render_mode: must be None; the single environment draws pictures.
          settings: as in `GliderEnv`, without `navigate`.

        Raises:
          InputError: a task for one vehicle only, navigation on board, or a render mode; and the
            errors of `GliderEnv`.
        """
        if render_mode is not None:
            raise InputError(
                f"render_mode {render_mode!r}: a vector environment draws no pictures; fly the "
                "same seed in the single environment, gymnasium.make(..., render_mode='rgb_array')"
            )
        if settings.get("navigate") is not None:
            raise InputError(
                "navigate: what is known on board is worked out in Python for each vehicle, so "
                "only the single environment has it (gymnasium.make, or "
                'make_vec(..., vectorization_mode="async")); noise={...} works here'
            )
        named = str(getattr(autoreset_mode, "name", autoreset_mode)).lower()
        if named not in AUTORESET:
            raise InputError(unknown_name("autoreset_mode", named, AUTORESET))
        self._mode = AUTORESET[named]
        if engine not in ENGINES:
            raise InputError(unknown_name("engine", str(engine), ENGINES))
        one = load_task(task, settings, OWN, ("navigate",))
        self.metadata = {
            "render_modes": [],
            "render_fps": 1.0 / one.control_timestep(),
            "autoreset_mode": self._mode,
        }
        self._observe(one.task, one.reset(), observation, noise)
        self.num_envs = num_envs
        self.single_observation_space = self._observations.space
        self.single_action_space = action_space(one)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.task: Any = one.task
        """Task whose goals have the vehicle as their first axis."""
        self.substeps, self._limit = one.substeps, one.limit
        law = settings.get("hydrodynamics", "coefficients")
        fly: Callable[..., Many] = _make_lanes if engine == "lanes" else _make_physics
        self.physics = fly(one, law, num_envs, threads)
        """Physics of all vehicles, with measurements by name."""
        self.task.serve([np.random.RandomState(0)] * num_envs)
        self._seeds: NDArray[np.int64] | None = None
        self._episodes = np.zeros(num_envs, np.int64)
        self._steps = np.zeros(num_envs, np.int64)
        self._over = np.zeros(num_envs, np.bool_)
        self._last: dict[str, Any] = {}

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start episodes.

        Args:
          seed: seed of the first vehicle, from which the others count up; or one for each vehicle;
            None continues with the next episodes.
          options: `reset_mask`, shape (num_envs,), True where an episode starts; default: all.

        Raises:
          InputError: an unknown option, or seeds or a mask of another length.
        """
        which = self._mask(options)
        self._take_seeds(seed, which)
        self._begin_episodes(which)
        return self._show(self.task.get_observation(self.physics)), {}

    def _mask(self, options: Mapping[str, Any] | None) -> Mask:
        for name in options or {}:
            if name != "reset_mask":
                raise InputError(unknown_name("option of reset", name, ("reset_mask",)))
        which = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_)))
        if which.shape != (self.num_envs,) or which.dtype != np.bool_:
            raise InputError(f"reset_mask must be {self.num_envs} booleans")
        if self._seeds is None and not which.all():
            raise InputError("the first reset begins every episode: leave reset_mask out")
        return which

    def _take_seeds(self, seed: int | Sequence[int | None] | None, which: Mask) -> None:
        if seed is None and self._seeds is not None:
            return
        fresh = self.np_random.integers(LARGEST_SEED, size=self.num_envs)
        seeds = fresh if self._seeds is None else self._seeds.copy()
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
            seed = [int(seed) + i for i in range(self.num_envs)]
        given = [None] * self.num_envs if seed is None else list(seed)
        if len(given) != self.num_envs:
            raise InputError(f"{len(given)} seeds for {self.num_envs} vehicles: give one for each")
        for i, value in enumerate(given):
            if which[i] and value is not None:
                seeds[i], self._episodes[i] = value, 0
        self._seeds = np.asarray(seeds, np.int64)

    def _begin_episodes(self, which: Mask) -> None:
        """Sample and start the next episode of the vehicles in a mask."""
        assert self._seeds is not None
        task, physics = self.task, self.physics
        begun = []
        for index in np.flatnonzero(which).tolist():
            at = (index,)
            task.set_generator(
                episode_random(int(self._seeds[index]), int(self._episodes[index])), at
            )
            begun.append((at, task.place(physics, at)))
        physics.settle(which)
        for at, episode in begun:
            task.begin(physics, at, episode)
        self._episodes[which] += 1
        self._steps[which] = 0
        self._over[which] = False

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Any, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Advance every vehicle by one control period.

        Raises:
          InputError: no episode has started, or with autoreset disabled one is over.
        """
        if self._seeds is None:
            raise InputError("no episode has begun: call reset first")
        if self._mode is AutoresetMode.DISABLED and self._over.any():
            raise InputError(
                f"the episodes of {np.flatnonzero(self._over).tolist()[:5]} are over: call "
                'reset(options={"reset_mask": ...}) with a mask of them'
            )
        task, physics = self.task, self.physics
        ended, flying = self._over.copy(), ~self._over
        physics.set_control(task.to_command(actions))
        physics.step(self.substeps, flying)
        if ended.any():
            self._begin_episodes(ended)
        task.after_step(physics)
        self._steps[flying] += 1
        failed = physics.failed()
        limit = self._steps >= self._limit
        rewards = np.where(failed | ended, 0.0, task.get_reward(physics))
        terminated = failed | (task.lost(physics) & ~limit & flying)
        truncated = limit & ~failed
        found = task.get_observation(physics)
        if failed.any():  # repeat the last finite ones: no NaN reaches a learner
            for name, values in found.items():
                values[failed] = self._last[name][failed]
        self._over = terminated | truncated
        info: dict[str, Any] = {}
        if self._mode is AutoresetMode.SAME_STEP and self._over.any():
            over = self._over.copy()
            info = self._final_info(over, found)
            self._begin_episodes(over)
            found = task.get_observation(physics)
        return self._show(found), rewards, terminated, truncated, info

    def _show(self, found: Mapping[str, Any]) -> Any:
        self._last = dict(found)
        return self._observations.show(found)

    def _errors(self) -> dict[str, NDArray[np.float64]]:
        """Errors of the observations in progress, by name, shape (num_envs, numbers)."""
        assert self._seeds is not None
        return self._noise.draw(self._seeds, self._episodes, self._steps)

    def _final_info(self, over: Mask, found: Mapping[str, Any]) -> dict[str, Any]:
        """Last observations of ended episodes, in the form of Gymnasium's vector environments."""
        shown = self._observations.show(found)
        final = np.full(self.num_envs, None, dtype=object)
        for index in np.flatnonzero(over).tolist():
            final[index] = (
                {name: values[index] for name, values in shown.items()}
                if isinstance(shown, dict)
                else shown[index]
            )
        return {"final_obs": final, "_final_obs": over}
