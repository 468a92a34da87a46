"""Depth: go to a wanted depth and stay there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from twin.control import rewards
from twin.control.environment import Environment, build
from twin.control.physics import Physics, WaterPhysics
from twin.control.task import Episode, GliderTask, Reference, place_marker, row, with_marker
from twin.numbers import Array
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle

TIME_LIMIT = 900.0
"""[s]"""
MAX_DEPTH = 200.0
"""[m]"""
DEPTHS = (20.0, 150.0)
"""[m] of start and target"""
BAND, MARGIN = 1.0, 50.0
"""[m] error that counts as none, and beyond it where the reward has fallen to 0.1"""
STILL, STILL_MARGIN = 0.02, 0.2
"""[m/s] vertical speed that counts as none, and beyond it where its share has fallen to 0.1"""
APPROACH = 15.0
"""[m] from the target where the reference starts to slow down"""
LEAD = 60.0
"""[s] by which the reference looks ahead: a glider needs that long to lose its way"""
MARKER_SIZE = "40 0.05"
"""[m] radius and half thickness of the disc that shows the wanted depth"""


def depth(
    vehicle: str = "glider",
    *,
    random: np.random.RandomState | int | None = None,
    time_limit: float = TIME_LIMIT,
    normalised: bool = True,
    hydrodynamics: str = "coefficients",
    environment_kwargs: Mapping[str, Any] | None = None,
) -> Environment:
    """Reach a random depth from rest at another one and stay."""
    glider = load_vehicle(vehicle)
    marked = with_marker(glider, type="cylinder", size=MARKER_SIZE)
    physics = Physics.from_vehicle(marked, hydrodynamics=hydrodynamics)
    task = Depth(glider, max_depth=MAX_DEPTH, normalised=normalised, random=random)
    return build(physics, task, time_limit=time_limit, settings=environment_kwargs)


class Depth(GliderTask):
    """Reward: mostly for being near, a quarter of it for being still there."""

    goals = MappingProxyType({"target_depth": ()})
    goal_scales = MappingProxyType({"to_target": 50.0})
    goals_from = MappingProxyType({"to_target": ("depth",)})
    target_depth: Any = 0.0
    """[m]"""

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """Depths of target and start; the glider rests, neutral and level."""
        target_depth = random.uniform(*DEPTHS)
        start = Start(depth=random.uniform(*DEPTHS), heading=random.uniform(0.0, 2.0 * math.pi))
        return Episode(start=start, goal={"target_depth": target_depth})

    def mark(self, physics: WaterPhysics) -> None:
        """A disc at the wanted depth."""
        place_marker(physics, 0.0, 0.0, self.target_depth)

    def error(self, physics: WaterPhysics) -> Any:
        """Wanted minus present depth [m], positive when it must dive."""
        return self.target_depth - physics.depth()

    def observe_goal(self, physics: WaterPhysics) -> dict[str, Array]:
        """`to_target`: wanted minus present depth [m]."""
        return {"to_target": row(self.error(physics))}

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Target and vehicle are above the depth limit, but for the last step."""
        farthest = self.max_depth + self.fastest * self.period
        return {"to_target": (-farthest, farthest)}

    def get_reward(self, physics: WaterPhysics) -> Any:
        """1 at rest at the wanted depth."""
        near = rewards.tolerance(
            self.error(physics), bounds=(-BAND, BAND), margin=MARGIN, sigmoid="long_tail"
        )
        still = rewards.tolerance(physics.depth_rate(), bounds=(-STILL, STILL), margin=STILL_MARGIN)
        return near * (3.0 + still) / 4.0

    def reference(self, physics: WaterPhysics) -> Reference:
        """Net buoyancy and pitch in proportion to the depth error LEAD seconds ahead."""
        ahead = self.error(physics) - LEAD * physics.depth_rate()
        effort = min(max(ahead / APPROACH, -1.0), 1.0)
        return Reference(
            pitch=-effort * self.cruise_pitch, heading=None, net_mass=effort * self.cruise_mass
        )
