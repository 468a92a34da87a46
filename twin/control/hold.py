"""Hold: tasks that keep something, a pitch and a heading in a glide, or a depth at rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from twin.control import rewards
from twin.control.environment import Environment, build
from twin.control.physics import Physics
from twin.control.task import (
    Episode,
    GliderTask,
    Reference,
    place_marker,
    row,
    with_marker,
    wrap_angle,
)
from twin.numbers import Array
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle

HOLD_TIME, HOLD_DEPTH = 600.0, 500.0
"""[s] of an episode; [m] limit of the depth"""
START_DEPTHS = (200.0, 300.0)
"""[m]: far from both ends of the water for the whole episode"""
PITCHES = (math.radians(30.0), math.radians(45.0))
"""[rad] magnitudes of wanted and initial pitch"""
PROPELLED_PITCHES = (math.radians(8.0), math.radians(18.0))
"""[rad] likewise of a vehicle under a propeller"""
LARGEST_TURN = math.radians(90.0)
"""[rad] between initial and wanted heading"""
PITCH_BAND, PITCH_MARGIN = math.radians(1.0), math.radians(20.0)
"""[rad] error that counts as none, and beyond it where the reward has fallen to 0.1"""
HEADING_BAND, HEADING_MARGIN = math.radians(2.0), math.radians(60.0)
"""[rad]"""
SPEED_SHARE = 0.5
"""Part of the cruise speed from which the speed is good enough: a drifting hull holds nothing"""


def hold(
    vehicle: str = "glider",
    *,
    random: np.random.RandomState | int | None = None,
    time_limit: float = HOLD_TIME,
    normalised: bool = True,
    hydrodynamics: str = "coefficients",
    environment_kwargs: Mapping[str, Any] | None = None,
) -> Environment:
    """Hold a random heading and pitch, in a dive or in a climb, from a glide on another one."""
    glider = load_vehicle(vehicle)
    physics = Physics.from_vehicle(glider, hydrodynamics=hydrodynamics)
    task = Hold(glider, max_depth=HOLD_DEPTH, normalised=normalised, random=random)
    return build(physics, task, time_limit=time_limit, settings=environment_kwargs)


class Hold(GliderTask):
    """Reward: product of how well pitch and heading are held and of flying fast enough to steer."""

    goals = MappingProxyType({"target_pitch": (), "target_heading": ()})
    goals_from = MappingProxyType({"to_target": ("attitude", "heading")})
    target_pitch: Any = 0.0
    """[rad]"""
    target_heading: Any = 0.0
    """[rad]"""

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """A glide to start from and one to hold."""
        heading = random.uniform(0.0, 2.0 * math.pi)
        goal = {
            "target_pitch": self._draw_pitch(random),
            "target_heading": (heading + random.uniform(-LARGEST_TURN, LARGEST_TURN)) % math.tau,
        }
        depth, pitch = random.uniform(*START_DEPTHS), self._draw_pitch(random)
        start = self.gliding_start(depth=depth, heading=heading, pitch=pitch)
        return Episode(start=start, goal=goal)

    def _draw_pitch(self, random: np.random.RandomState) -> float:
        sense = 1.0 if random.uniform() < 0.5 else -1.0
        pitches = PROPELLED_PITCHES if self.propelled else PITCHES
        return sense * float(random.uniform(*pitches))

    def pitch_error(self, physics: Physics) -> Any:
        """Wanted minus present pitch [rad]."""
        return self.target_pitch - physics.pitch()

    def heading_error(self, physics: Physics) -> Any:
        """Wanted minus present heading [rad], in [-pi, pi)."""
        return wrap_angle(self.target_heading - physics.heading())

    def observe_goal(self, physics: Physics) -> dict[str, Array]:
        """`to_target`: pitch error [rad], sine and cosine of the heading error."""
        error = self.heading_error(physics)
        return {"to_target": row(self.pitch_error(physics), np.sin(error), np.cos(error))}

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Pitches are within a quarter turn."""
        return {"to_target": (-math.pi, math.pi)}

    def get_reward(self, physics: Physics) -> Any:
        """1 on pitch and heading at half the cruise speed or more."""
        enough = SPEED_SHARE * self.cruise.speed
        pitch = rewards.tolerance(
            self.pitch_error(physics), bounds=(-PITCH_BAND, PITCH_BAND), margin=PITCH_MARGIN
        )
        heading = rewards.tolerance(
            self.heading_error(physics),
            bounds=(-HEADING_BAND, HEADING_BAND),
            margin=HEADING_MARGIN,
            sigmoid="long_tail",
        )
        flying = rewards.tolerance(
            physics.speed(),
            bounds=(enough, math.inf),
            margin=enough,
            sigmoid="linear",
            value_at_margin=0.0,
        )
        return pitch * heading * flying

    def reference(self, physics: Physics) -> Reference:
        """The target, with the cruise's buoyancy."""
        net_mass = -math.copysign(self.cruise_mass, self.target_pitch)
        return Reference(pitch=self.target_pitch, heading=self.target_heading, net_mass=net_mass)


DEPTH_TIME, DEPTH_LIMIT = 900.0, 200.0
"""[s] of an episode; [m] limit of the depth"""
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
    time_limit: float = DEPTH_TIME,
    normalised: bool = True,
    hydrodynamics: str = "coefficients",
    environment_kwargs: Mapping[str, Any] | None = None,
) -> Environment:
    """Reach a random depth from rest at another one and stay."""
    glider = load_vehicle(vehicle)
    marked = with_marker(glider, type="cylinder", size=MARKER_SIZE)
    physics = Physics.from_vehicle(marked, hydrodynamics=hydrodynamics)
    task = Depth(glider, max_depth=DEPTH_LIMIT, normalised=normalised, random=random)
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

    def mark(self, physics: Physics) -> None:
        """A disc at the wanted depth."""
        place_marker(physics, 0.0, 0.0, self.target_depth)

    def error(self, physics: Physics) -> Any:
        """Wanted minus present depth [m], positive when it must dive."""
        return self.target_depth - physics.depth()

    def observe_goal(self, physics: Physics) -> dict[str, Array]:
        """`to_target`: wanted minus present depth [m]."""
        return {"to_target": row(self.error(physics))}

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Target and vehicle are above the depth limit, but for the last step."""
        farthest = self.max_depth + self.fastest * self.period
        return {"to_target": (-farthest, farthest)}

    def get_reward(self, physics: Physics) -> Any:
        """1 at rest at the wanted depth."""
        near = rewards.tolerance(
            self.error(physics), bounds=(-BAND, BAND), margin=MARGIN, sigmoid="long_tail"
        )
        still = rewards.tolerance(physics.depth_rate(), bounds=(-STILL, STILL), margin=STILL_MARGIN)
        return near * (3.0 + still) / 4.0

    def reference(self, physics: Physics) -> Reference:
        """Net buoyancy and pitch in proportion to the depth error LEAD seconds ahead."""
        ahead = self.error(physics) - LEAD * physics.depth_rate()
        effort = min(max(ahead / APPROACH, -1.0), 1.0)
        return Reference(
            pitch=-effort * self.cruise_pitch, heading=None, net_mass=effort * self.cruise_mass
        )
