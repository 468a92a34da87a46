"""Suite: the tasks as environments of dm_control, which needs the extra `suite`.

The loop of an episode, the task and the physics are the project's own; here they are shown as
`dm_control.suite` shows its own, with dm_control's physics around the same MuJoCo model.
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
"""dm-control 1.0.50 cannot load models under MuJoCo 4; the extra `suite` carries the same bound."""
ALONE = 'pip install --no-deps "dm-control>=1.0.50,<2"'
"""dm-control asks for labmaze, which has no wheel from Python 3.13 on and which is not needed; so
the extra does not bring dm-control there."""
DM_SETTINGS = ("flat_observation", "legacy_step")
"""What `environment_kwargs` has for dm_control beside those of `twin.control.environment.build`"""
_BACKEND = "MUJOCO_GL"
_SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")


def require_dm_control() -> None:
    """Check that dm_control is installed beside a MuJoCo that it can use.

    Raises:
      InputError: it is not; the message has the one line that installs both.
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
    """Name a backend in MUJOCO_GL where there is no screen and nobody has named one.

    dm_control settles how it draws while it is imported. It tries GLFW first, which warns without a
    screen. With a screen, or with MUJOCO_GL set, the choice stays dm_control's and the user's.
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
    """A vehicle in water: `dm_control.mujoco.Physics` with the twin's model and callbacks.

    Build it with `from_vehicle`. Models that `compile_model` did not make are refused, because
    they would move in vacuum. Copies, pickles and binary models carry their water with them.
    """

    unstable: ClassVar[type[Exception]] = control.PhysicsError

    # --- making one ---------------------------------------------------------------------------

    @classmethod
    def from_model(cls, model: mujoco.MjModel | wrapper.MjModel) -> Self:
        """From a model that `compile_model` made, taken as it is.

        Raises:
          VehicleError: the model does not carry the twin's parameter block.
        """
        if isinstance(model, mujoco.MjModel):
            model = wrapper.MjModel(model)
        header(model.ptr)  # raises for models without a block
        return super().from_model(model)

    @classmethod
    def from_xml_path(cls, file_path: str | Path) -> Self:
        """From a vehicle file; see `from_vehicle`."""
        return cls.from_vehicle(load_vehicle(file_path))

    @classmethod
    def from_xml_string(cls, xml_string: str, assets: Mapping[str, Any] | None = None) -> Self:
        """From the text of a vehicle file; `assets` must be empty: vehicle files stand alone."""
        return cls.from_vehicle(_vehicle_from_text(xml_string, assets))

    @classmethod
    def from_byte_string(cls, byte_string: bytes) -> Self:
        """From a binary model, with the water that it carries."""
        return cls.from_model(wrapper.MjModel.from_byte_string(byte_string))

    @classmethod
    def from_binary_path(cls, file_path: str) -> Self:
        """From a file with a binary model, with the water that it carries."""
        return cls.from_model(wrapper.MjModel.from_binary_path(file_path))

    def reload_from_xml_path(self, file_path: str | Path) -> None:
        """Become a new instance of `from_xml_path`."""
        self._reload_from_data(self.from_xml_path(file_path).data)

    def reload_from_xml_string(
        self, xml_string: str, assets: Mapping[str, Any] | None = None
    ) -> None:
        """Become a new instance of `from_xml_string`."""
        self._reload_from_data(self.from_xml_string(xml_string, assets).data)

    def _reload_from_data(self, data: wrapper.MjData) -> None:
        header(data.model.ptr)
        install()  # dm_control computes with the new data at once
        super()._reload_from_data(data)
        self._attach(data.model.ptr, data.ptr)

    # --- state --------------------------------------------------------------------------------

    def _physics_state_items(self) -> list[NDArray[np.float64]]:
        # userdata holds what the time-centred water remembers of the step before
        return [*super()._physics_state_items(), self.data.userdata]

    def step(self, nstep: int = 1) -> None:
        """Advance by `nstep` steps.

        Raises:
          PhysicsError: the state left the finite numbers.
        """
        super().step(nstep)
        if not self.legacy_step:
            mujoco.mj_step1(self.model.ptr, self.data.ptr)
        if (failure := self._failure()) is not None:
            raise control.PhysicsError(failure)

    def reset(self, keyframe_id: int | None = None) -> None:
        """Back to the model's initial state, with nothing remembered of earlier velocities."""
        super().reset(keyframe_id)
        self.data.userdata[:] = 0.0

    def after_reset(self) -> None:
        """Bring everything up to date with a new state.

        dm_control's own switches actuation off here. The stiff servos then are missing from what
        the `discrete` integrator prepares for the first step, which throws the battery away.
        """
        self.forward()

    @property
    def contexts(self) -> Any:
        """What dm_control draws with.

        Raises:
          ForkedDrawing: this process was forked from one that had drawn.
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
    """A task with a glider, as an environment of dm_control.

    When the state leaves the finite numbers, the episode ends with reward 0, discount 0 and the
    last finite observation, so that no NaN reaches a learner; with `raise_on_instability` the
    `PhysicsError` goes through instead.
    """

    def __init__(
        self, own: Environment, *, flat_observation: bool = False, legacy_step: bool = True
    ):
        """Show an environment of this project, whose physics becomes a `SuitePhysics`.

        Args:
          flat_observation: one array in place of named ones. legacy_step: see dm_control.
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
        """The project's environment behind it"""

    def reset(self) -> dm_env.TimeStep:
        """Start a new episode."""
        found = self._shown(self.own.reset())
        return dm_env.TimeStep(dm_env.StepType.FIRST, None, None, found)

    def step(self, action: Any) -> dm_env.TimeStep:
        """Advance by one control timestep, or start a new episode after the last step of one."""
        if self.own.over:
            return self.reset()
        done = self.own.step(action)
        kind = dm_env.StepType.LAST if done.over else dm_env.StepType.MID
        return dm_env.TimeStep(kind, done.reward, done.discount, self._shown(done.observation))

    def _shown(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        return control.flatten_observation(observation) if self._flat else observation

    def action_spec(self) -> specs.BoundedArray:
        """Bounds of the commands; the name lists the actuators, separated by tabs."""
        low, high = self.own.task.action_range()
        names = "\t".join(self.own.task.vehicle.part_names)
        return specs.BoundedArray(low.shape, np.float64, low, high, name=names)

    def observation_spec(self) -> Mapping[str, specs.Array]:
        """Shape and kind of each observation, by name."""
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
    """The environment of a task, for dm_control.

    Args:
      task_name: one of `twin.control.TASKS`.
      task_kwargs: vehicle (name or path), random (seed or RandomState), time_limit [s],
        normalised (actions from -1 to 1), hydrodynamics; `energy` also takes consumption.
      environment_kwargs: of `twin.control.environment.Environment`, e.g. control_timestep [s],
        raise_on_instability; flat_observation and legacy_step as in dm_control.
      visualize_reward: colour the hull by the reward.

    Raises:
      InputError: unknown task or argument; and what vehicle and task raise.
    """
    settings = dict(environment_kwargs or {})
    shown = {name: settings.pop(name) for name in DM_SETTINGS if name in settings}
    environment = SuiteEnvironment(load_environment(task_name, task_kwargs, settings), **shown)
    if not isinstance(visualize_reward, bool):
        raise InputError(f"visualize_reward is {visualize_reward!r}: give True or False")
    environment.task.visualize_reward = visualize_reward
    return environment
