"""The suite's tasks for Gymnasium and stable-baselines3, one vehicle or many at once.

Importing this package registers them: `gymnasium.make("glider_twin/Depth-v0")` and
`gymnasium.make_vec("glider_twin/Depth-v0", num_envs=64)`. Gymnasium imports it by itself where the
name says so: `gymnasium.make("twin.gym:glider_twin/Depth-v0")`. `GliderEnv` and `GliderVectorEnv`
also take tasks of one's own by their names, and `StableBaselinesVec` makes a vector environment one
of stable-baselines3.
"""

from typing import TYPE_CHECKING

from twin.extras import require
from twin.lazy import attach

require("gymnasium", extra="gym", purpose="twin.gym")

from twin.gym.registration import register_environments  # noqa: E402

if TYPE_CHECKING:
    from twin.gym.environment import GliderEnv as GliderEnv
    from twin.gym.stable_baselines import StableBaselinesVec as StableBaselinesVec
    from twin.gym.vector import GliderVectorEnv as GliderVectorEnv

_PLACES = {
    "GliderEnv": "twin.gym.environment:GliderEnv",
    "GliderVectorEnv": "twin.gym.vector:GliderVectorEnv",
    "StableBaselinesVec": "twin.gym.stable_baselines:StableBaselinesVec",
}
__all__ = ["GliderEnv", "GliderVectorEnv", "StableBaselinesVec"]
__getattr__, __dir__ = attach(__name__, _PLACES)

register_environments()
