"""Stable-baselines: a vector environment in the form of stable-baselines3's `VecEnv`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from twin.control.vector_env import GliderVectorEnv
from twin.errors import InputError
from twin.extras import require

require("stable_baselines3", extra="sb3", purpose="twin.control.StableBaselinesVec")

from stable_baselines3.common.vec_env import VecEnv  # noqa: E402


class StableBaselinesVec(VecEnv):
    """`VecEnv` of stable-baselines3 over a `GliderVectorEnv`.

    Wrappers and attributes of single vehicles are not supported, because all vehicles are one
    object. `VecMonitor` and `VecNormalize` can wrap it.
    """

    def __init__(self, environment: GliderVectorEnv):
        """Wrap a vector environment that resets in the same step.

        Raises:
          InputError: the environment has another autoreset mode.
        """
        if environment.metadata["autoreset_mode"] is not AutoresetMode.SAME_STEP:
            raise InputError(
                "stable-baselines3 begins an episode in the step that ends the one before: make "
                'the environment with autoreset_mode="same_step"'
            )
        self.environment = environment
        super().__init__(
            environment.num_envs,
            environment.single_observation_space,
            environment.single_action_space,
        )
        self._actions: NDArray[np.float32] | None = None

    def reset(self) -> Any:
        """First observations, from the seeds given to `seed`, if any."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, _ = self.environment.reset(seed=seeds)
        self._reset_seeds()
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Store the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Advance every vehicle by one control period."""
        assert self._actions is not None
        found, rewards, terminated, truncated, info = self.environment.step(self._actions)
        over = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for index in np.flatnonzero(over).tolist():
            infos[index] = {
                "terminal_observation": info["final_obs"][index],
                "TimeLimit.truncated": bool(truncated[index]),
            }
        return found, rewards.astype(np.float32), over, infos

    def close(self) -> None:
        """Close the vector environment."""
        self.environment.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Attribute of the vector environment, repeated for each requested vehicle."""
        return [getattr(self.environment, attr_name)] * len(self._indices(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise InputError: the vehicles are one object."""
        raise InputError(f"{attr_name}: vehicles of a vector environment have no attributes alone")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Raise InputError: the vehicles are one object."""
        raise InputError(f"{method_name}: vehicles of a vector environment have no methods alone")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each vehicle: no wrapper acts on a single one."""
        return [False] * len(self._indices(indices))

    def _indices(self, indices: int | Iterable[int] | None) -> Sequence[int]:
        return list(self._get_indices(indices))
