"""Gym: the suite's tasks as Gymnasium environments, through shimmy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from twin.errors import TwinError
from twin.suite.loader import load

if TYPE_CHECKING:
    import gymnasium

_EXTRA = "gym"


class MissingExtra(TwinError):
    """An optional library is not installed."""


def make(
    task_name: str,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    *,
    render_mode: str | None = None,
    render_kwargs: Mapping[str, Any] | None = None,
) -> gymnasium.Env:
    """A task of `twin.suite.load` as a Gymnasium environment.

    Observations are a Dict space, or a Dict with one flat Box when `environment_kwargs` has
    `flat_observation=True`. The end of the time limit is a truncation; the surface, the depth
    limit and an instability are terminations. `reset(seed=...)` reseeds the task.

    Args:
      task_name, task_kwargs, environment_kwargs: as in `twin.suite.load`.
      render_mode: None, "rgb_array", "depth_array", "multi_camera" or, with a screen, "human".
      render_kwargs: height, width, camera_id of `dm_control`'s `render`.

    Raises:
      MissingExtra: gymnasium, shimmy or what they need is not installed.
      InputError: as `twin.suite.load`.
    """
    try:
        from shimmy.dm_control_compatibility import DmControlCompatibilityV0
    except ImportError as error:
        raise MissingExtra(
            f"Gymnasium environments need the extra {_EXTRA!r} ({error}): "
            f"pip install 'glider-twin[{_EXTRA}]'"
        ) from error
    environment = load(task_name, task_kwargs, environment_kwargs)
    wrapped = DmControlCompatibilityV0(
        environment,
        render_mode=render_mode,
        render_kwargs=dict(render_kwargs or {}),
    )
    # shimmy notes a rate a thousand times the period, in a dict that all its instances share
    frames_per_second = 1.0 / environment.control_timestep()
    wrapped.metadata = {**wrapped.metadata, "render_fps": frames_per_second}
    return wrapped
