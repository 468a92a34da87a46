"""Hold: tasks that hold a pitch and a heading in a glide, or a depth at rest."""

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
"""HOLD_TIME: [s] duration of an episode. HOLD_DEPTH: [m] limit of depth."""
START_DEPTHS = (200.0, 300.0)
"""[m] Range of depths at the start, far from surface and depth limit for a whole episode."""
PITCHES = (math.radians(30.0), math.radians(45.0))
"""[rad] Range of magnitudes of target pitch and initial pitch."""
PROPELLED_PITCHES = (math.radians(8.0), math.radians(18.0))
"""[rad] Range of magnitudes of target and initial pitch of a propelled vehicle."""
LARGEST_TURN = math.radians(90.0)
"""[rad] Largest angle between initial and target heading."""
PITCH_BAND, PITCH_MARGIN = math.radians(1.0), math.radians(20.0)
"""[rad] PITCH_BAND: error with full reward. PITCH_MARGIN: error beyond it with reward 0.1."""
HEADING_BAND, HEADING_MARGIN = math.radians(2.0), math.radians(60.0)
"""[rad] HEADING_BAND: error with full reward. HEADING_MARGIN: error beyond it with reward 0.1."""
SPEED_SHARE = 0.5
"""[1] Fraction of the cruise speed from which on the reward is full; a drifting hull gets none."""


def hold(
    vehicle: str = "glider",
    *,
    random: np.random.RandomState | int | None = None,
    time_limit: float = HOLD_TIME,
    normalised: bool = True,
    hydrodynamics: str = "coefficients",
    environment_kwargs: Mapping[str, Any] | None = None,
) -> Environment:
    """Hold a random heading and pitch, in a dive or a climb, starting from another glide."""
    glider = load_vehicle(vehicle)
    physics = Physics.from_vehicle(glider, hydrodynamics=hydrodynamics)
    task = Hold(glider, max_depth=HOLD_DEPTH, normalised=normalised, random=random)
    return build(physics, task, time_limit=time_limit, settings=environment_kwargs)


class Hold(GliderTask):
    """Hold task. Reward: product of pitch, heading and sufficient speed, 0 to 1 each."""

    goals = MappingProxyType({"target_pitch": (), "target_heading": ()})
    goals_from = MappingProxyType({"to_target": ("attitude", "heading")})
    target_pitch: Any = 0.0
    """[rad] Target pitch."""
    target_heading: Any = 0.0
    """[rad] Target heading."""

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """Sample the glide at the start and the one to hold."""
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
        """Target minus present pitch [rad]."""
        return self.target_pitch - physics.pitch()

    def heading_error(self, physics: Physics) -> Any:
        """Target minus present heading [rad], in [-pi, pi)."""
        return wrap_angle(self.target_heading - physics.heading())

    def observe_goal(self, physics: Physics) -> dict[str, Array]:
        """Observe `to_target`: pitch error [rad], sine and cosine of the heading error."""
        error = self.heading_error(physics)
        return {"to_target": row(self.pitch_error(physics), np.sin(error), np.cos(error))}

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Limits of the goal; pitches are within a quarter turn."""
        return {"to_target": (-math.pi, math.pi)}

    def get_reward(self, physics: Physics) -> Any:
        """Reward of 1 at target pitch and heading, with at least half the cruise speed."""
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
        """Target pitch and heading, with the cruise's net buoyancy."""
        net_mass = -math.copysign(self.cruise_mass, self.target_pitch)
        return Reference(pitch=self.target_pitch, heading=self.target_heading, net_mass=net_mass)


DEPTH_TIME, DEPTH_LIMIT = 900.0, 200.0
"""DEPTH_TIME: [s] duration of an episode. DEPTH_LIMIT: [m] limit of depth."""
DEPTHS = (20.0, 150.0)
"""[m] Range of depths of start and target."""
BAND, MARGIN = 1.0, 50.0
"""[m] BAND: depth error with full reward. MARGIN: error beyond it with reward 0.1."""
STILL, STILL_MARGIN = 0.02, 0.2
"""[m/s] STILL: vertical speed with full reward. STILL_MARGIN: excess at which its share is 0.1."""
APPROACH = 15.0
"""[m] Distance from the target at which the reference starts to slow down."""
LEAD = 60.0
"""[s] Time by which the reference looks ahead, about what a glider needs to stop."""
MARKER_SIZE = "40 0.05"
"""[m] Radius and half thickness of the disc that shows the target depth."""


def depth(
    vehicle: str = "glider",
    *,
    random: np.random.RandomState | int | None = None,
    time_limit: float = DEPTH_TIME,
    normalised: bool = True,
    hydrodynamics: str = "coefficients",
    environment_kwargs: Mapping[str, Any] | None = None,
) -> Environment:
    """Reach a random depth from rest at another depth, and stay."""
    glider = load_vehicle(vehicle)
    marked = with_marker(glider, type="cylinder", size=MARKER_SIZE)
    physics = Physics.from_vehicle(marked, hydrodynamics=hydrodynamics)
    task = Depth(glider, max_depth=DEPTH_LIMIT, normalised=normalised, random=random)
    return build(physics, task, time_limit=time_limit, settings=environment_kwargs)


class Depth(GliderTask):
    """Depth task. Reward: three quarters for a small depth error, a quarter for stillness there."""

    goals = MappingProxyType({"target_depth": ()})
    goal_scales = MappingProxyType({"to_target": 50.0})
    goals_from = MappingProxyType({"to_target": ("depth",)})
    target_depth: Any = 0.0
    """[m] Target depth."""

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """Sample the depths of target and start; the glider is at rest, neutral and level."""
        target_depth = random.uniform(*DEPTHS)
        start = Start(depth=random.uniform(*DEPTHS), heading=random.uniform(0.0, 2.0 * math.pi))
        return Episode(start=start, goal={"target_depth": target_depth})

    def mark(self, physics: Physics) -> None:
        """Move the marker, a disc, to the target depth."""
        place_marker(physics, 0.0, 0.0, self.target_depth)

    def error(self, physics: Physics) -> Any:
        """Target minus present depth [m], positive if the vehicle must dive."""
        return self.target_depth - physics.depth()

    def observe_goal(self, physics: Physics) -> dict[str, Array]:
        """Observe `to_target`: target minus present depth [m]."""
        return {"to_target": row(self.error(physics))}

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Limits of the goal: the depth limit, plus the path of the last step."""
        farthest = self.max_depth + self.fastest * self.period
        return {"to_target": (-farthest, farthest)}

    def get_reward(self, physics: Physics) -> Any:
        """Reward of 1 at rest at the target depth."""
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
