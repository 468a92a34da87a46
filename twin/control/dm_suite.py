"""Dm_control suite: the tasks as environments of dm_control, which needs the extra `suite`.

Episodes, tasks and physics are the project's own. They get the interface of `dm_control.suite`,
with dm_control's physics around the same MuJoCo model.
"""

# ruff: noqa: E402 - dm_control and MuJoCo settle how they draw while they are imported
from __future__ import annotations

import collections
import os
import sys
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar, Self

from twin.errors import InputError
from twin.extras import preload_triton, require
from twin.show.render.context import available_backend, claim_drawing

MUJOCO_BELOW = 4
"""First major version of MuJoCo that dm-control 1.0.50 cannot use; the extra has this bound too."""
ALONE = 'pip install --no-deps "dm-control>=1.0.50,<2"'
"""Command that installs dm-control alone: it requires labmaze, which is not needed and has no wheel
from Python 3.13 on, so the extra leaves dm-control out there."""
DM_SETTINGS = ("flat_observation", "legacy_step")
"""Keys of `environment_kwargs` for dm_control, besides those of `environment.build`."""
_BACKEND = "MUJOCO_GL"
_SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")


def require_dm_control() -> None:
    """Check that dm_control is installed, next to a MuJoCo that it can use.

    Raises:
      InputError: dm_control is missing or MuJoCo too new; the message gives the install command.
    """
    version = metadata.version("mujoco")
    line = 'pip install "glider-twin[suite]"'
    if int(version.partition(".")[0]) >= MUJOCO_BELOW:
        raise InputError(
            f"dm_control's tasks need a mujoco below {MUJOCO_BELOW}, and mujoco {version} is "
            f"installed: {line} brings an older one; the same tasks for Gymnasium "
            "(twin.control.GliderEnv, GliderVectorEnv) fly on this one"
        )
    then = f" && {ALONE}" if sys.version_info >= (3, 13) else ""
    require("dm_control", extra="suite", purpose="a task of dm_control", load=False, then=then)


def choose_backend() -> None:
    """Set MUJOCO_GL to a backend if there is no screen and the user has set none.

    dm_control chooses its backend at import. It tries GLFW first, which warns without a screen.
    With a screen, or with MUJOCO_GL set, the choice is left to dm_control or the user.
    """
    preload_triton()  # dm_control opens OpenGL while it is imported
    if os.environ.get(_BACKEND) or not sys.platform.startswith("linux"):
        return
    if not any(os.environ.get(screen) for screen in _SCREENS):
        os.environ[_BACKEND] = available_backend() or "disable"


require_dm_control()
choose_backend()

import dm_env
import mujoco
import numpy as np
from dm_control import mujoco as dm_mujoco
from dm_control.mujoco import wrapper
from dm_control.rl import control
from dm_env import specs
from numpy.typing import NDArray

from twin.control.environment import Environment, load_environment
from twin.control.physics import Physics
from twin.physics.model_block import header
from twin.physics.native.install import install
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle


class SuitePhysics(dm_mujoco.Physics, Physics):
    """Vehicle in water: `dm_control.mujoco.Physics` with the twin's model and callbacks.

    Build it with `from_vehicle`. Models that `compile_model` did not make are refused, because they
    would move in vacuum. Copies, pickles and binary models carry their water with them.
    """

    unstable: ClassVar[type[Exception]] = control.PhysicsError

    # --- making one ---------------------------------------------------------------------------

    @classmethod
    def from_model(cls, model: mujoco.MjModel | wrapper.MjModel) -> Self:
        """Make the physics of a model from `compile_model`, without changing it.

        Raises:
          VehicleError: the model does not carry the twin's parameter block.
        """
        if isinstance(model, mujoco.MjModel):
            model = wrapper.MjModel(model)
        header(model.ptr)  # raises for models without a block
        return super().from_model(model)

    @classmethod
    def from_xml_path(cls, file_path: str | Path) -> Self:
        """Make the physics of a vehicle file; see `from_vehicle`."""
        return cls.from_vehicle(load_vehicle(file_path))

    @classmethod
    def from_xml_string(cls, xml_string: str, assets: Mapping[str, Any] | None = None) -> Self:
        """Make the physics from a vehicle file's text; `assets` must be empty."""
        return cls.from_vehicle(_vehicle_from_text(xml_string, assets))

    @classmethod
    def from_byte_string(cls, byte_string: bytes) -> Self:
        """Make the physics of a binary model, with the water that it carries."""
        return cls.from_model(wrapper.MjModel.from_byte_string(byte_string))

    @classmethod
    def from_binary_path(cls, file_path: str) -> Self:
        """Make the physics of a file with a binary model, with the water that it carries."""
        return cls.from_model(wrapper.MjModel.from_binary_path(file_path))

    def reload_from_xml_path(self, file_path: str | Path) -> None:
        """Replace this object's state by a new instance of `from_xml_path`."""
        self._reload_from_data(self.from_xml_path(file_path).data)

    def reload_from_xml_string(
        self, xml_string: str, assets: Mapping[str, Any] | None = None
    ) -> None:
        """Replace this object's state by a new instance of `from_xml_string`."""
        self._reload_from_data(self.from_xml_string(xml_string, assets).data)

    def _reload_from_data(self, data: wrapper.MjData) -> None:
        header(data.model.ptr)
        install()  # dm_control uses the new data at once
        super()._reload_from_data(data)
        self._attach(data.model.ptr, data.ptr)

    # --- state --------------------------------------------------------------------------------

    def _physics_state_items(self) -> list[NDArray[np.float64]]:
        # userdata holds the previous step's velocities for the time-centred water
        return [*super()._physics_state_items(), self.data.userdata]

    def step(self, nstep: int = 1) -> None:
        """Advance by `nstep` steps.

        Raises:
          PhysicsError: the state is no longer finite.
        """
        super().step(nstep)
        if not self.legacy_step:
            mujoco.mj_step1(self.model.ptr, self.data.ptr)
        if (failure := self._failure()) is not None:
            raise control.PhysicsError(failure)

    def reset(self, keyframe_id: int | None = None) -> None:
        """Return to the model's initial state, and clear the velocities of earlier steps."""
        super().reset(keyframe_id)
        self.data.userdata[:] = 0.0

    def after_reset(self) -> None:
        """Update all quantities to a new state.

        dm_control's own method disables actuation here. The `discrete` integrator then prepares the
        first step without the stiff servos, which throws the battery away.
        """
        self.forward()

    @property
    def contexts(self) -> Any:
        """Contexts with which dm_control draws.

        Raises:
          ForkedDrawing: this process was forked from one that has drawn.
        """
        claim_drawing()
        return super().contexts


def _vehicle_from_text(xml: str, assets: Mapping[str, Any] | None) -> Vehicle:
    if assets:
        raise InputError(
            f"assets {', '.join(sorted(assets))}: a vehicle file stands alone; write meshes into "
            "it with <mesh vertex=...>"
        )
    return parse_vehicle(xml, Path("vehicle.xml"))


class SuiteEnvironment(control.Environment):
    """Task with a glider as an environment of dm_control.

    If the state is no longer finite, the episode ends with reward 0, discount 0 and the last finite
    observation, so that no NaN reaches a learner. With `raise_on_instability` the `PhysicsError` is
    raised instead.
    """

    def __init__(
        self, own: Environment, *, flat_observation: bool = False, legacy_step: bool = True
    ):
        """Wrap an environment of this project, whose physics becomes a `SuitePhysics`.

        Args:
          flat_observation: one array instead of one by name. legacy_step: see dm_control.
        """
        physics = SuitePhysics.from_model(own.physics.mj_model)
        own.physics = physics
        super().__init__(
            physics,
            own.task,
            n_sub_steps=own.substeps,
            flat_observation=flat_observation,
            legacy_step=legacy_step,
        )
        self._flat = flat_observation
        self.own = own
        """Wrapped environment of the project."""

    def reset(self) -> dm_env.TimeStep:
        """Start a new episode."""
        found = self._shown(self.own.reset())
        return dm_env.TimeStep(dm_env.StepType.FIRST, None, None, found)

    def step(self, action: Any) -> dm_env.TimeStep:
        """Advance by one control period, or start a new episode after the last step of one."""
        if self.own.over:
            return self.reset()
        done = self.own.step(action)
        kind = dm_env.StepType.LAST if done.over else dm_env.StepType.MID
        return dm_env.TimeStep(kind, done.reward, done.discount, self._shown(done.observation))

    def _shown(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        return control.flatten_observation(observation) if self._flat else observation

    def action_spec(self) -> specs.BoundedArray:
        """Limits of the commands; the name lists the parts, separated by tabs."""
        low, high = self.own.task.action_range()
        names = "\t".join(self.own.task.vehicle.part_names)
        return specs.BoundedArray(low.shape, np.float64, low, high, name=names)

    def observation_spec(self) -> Mapping[str, specs.Array]:
        """Shape and dtype of each observation, by name."""
        found = self._shown(self.own.task.get_observation(self.own.physics))
        return collections.OrderedDict(
            (name, specs.Array(value.shape, value.dtype, name=name))
            for name, value in found.items()
        )


def load(
    task_name: str,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    visualize_reward: bool = False,
) -> SuiteEnvironment:
    """Make the environment of a task for dm_control.

    Args:
      task_name: one of `twin.control.TASKS`.
      task_kwargs: vehicle (name or path), random (seed or RandomState), time_limit [s],
        normalised (actions from -1 to 1), hydrodynamics; `energy` also takes consumption.
      environment_kwargs: arguments of `twin.control.environment.Environment`, e.g.
        control_timestep [s], raise_on_instability; flat_observation and legacy_step of dm_control.
      visualize_reward: colour the hull by the reward.

    Raises:
      InputError: unknown task or argument; and the errors of vehicle and task.
    """
    settings = dict(environment_kwargs or {})
    shown = {name: settings.pop(name) for name in DM_SETTINGS if name in settings}
    environment = SuiteEnvironment(load_environment(task_name, task_kwargs, settings), **shown)
    if not isinstance(visualize_reward, bool):
        raise InputError(f"visualize_reward is {visualize_reward!r}: give True or False")
    environment.task.visualize_reward = visualize_reward
    return environment
