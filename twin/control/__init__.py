"""Control tasks: a glider holds a pitch, reaches a depth, follows waypoints, saves energy; an ROV
reaches a pose, holds it in a current, follows a path.

The tasks, their water and their rewards need MuJoCo alone. They use its model and the native
callbacks of batches, and have three interfaces:

- Gymnasium (extra `gym`): importing this package registers `glider_twin/Depth-v0` and the others;
  `gymnasium.make("twin.control:glider_twin/Depth-v0")` imports it by itself. `GliderEnv` and
  `GliderVectorEnv` also take your own tasks by name.
- stable-baselines3 (extra `sb3`): `StableBaselinesVec` wraps a `GliderVectorEnv`.
- dm_control (extra `suite`): `load("hold", task_kwargs={"random": 1})` returns a `dm_env`
  environment, and `python -m twin.control --task hold` shows one in the viewer.

`TASKS` has every task by name, `ALL_TASKS` names those of the package, `register` adds one.
"""

import importlib.util
from typing import TYPE_CHECKING, Any

from twin.control.registry import register_environments
from twin.extras import require
from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.control.dm_suite import load as load
    from twin.control.glider_env import GliderEnv as GliderEnv
    from twin.control.registry import ALL_TASKS as ALL_TASKS
    from twin.control.registry import TASKS as TASKS
    from twin.control.registry import register as register
    from twin.control.stable_baselines import StableBaselinesVec as StableBaselinesVec
    from twin.control.vector_env import GliderVectorEnv as GliderVectorEnv

_PLACES = places(__name__)
_OF_GYMNASIUM = ("GliderEnv", "GliderVectorEnv", "StableBaselinesVec")
__all__ = [*_PLACES]
_get, __dir__ = attach(__name__, _PLACES)


def __getattr__(name: str) -> Any:
    if name in _OF_GYMNASIUM:
        require("gymnasium", extra="gym", purpose=f"twin.control.{name}")
    return _get(name)


if importlib.util.find_spec("gymnasium") is not None:
    register_environments()
