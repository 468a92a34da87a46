"""Pose: tasks of a vehicle with thrusters: reach a pose, hold it in a current, follow a path."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
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
    as_direction,
    place_marker,
    row,
    with_marker,
    wrap_angle,
)
from twin.errors import MissionError
from twin.mission.way import Way
from twin.numbers import Array
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.profile import Uniform

VEHICLE = "bluerov2"
TIME_LIMIT, MAX_DEPTH = 60.0, 40.0
"""TIME_LIMIT: [s] duration of an episode. MAX_DEPTH: [m] limit of depth."""
START_DEPTHS = (10.0, 20.0)
"""[m] Range of depths at the start."""
NEAR, MARGIN = 0.1, 2.0
"""[m] NEAR: distance with full reward. MARGIN: distance beyond it with reward 0.1."""
FACING, FACING_MARGIN = math.radians(3.0), math.radians(60.0)
"""[rad] FACING: heading error with full reward. FACING_MARGIN: error beyond it with reward 0.1."""
DISTANCES, RISE = (2.0, 6.0), 2.0
"""[m] DISTANCES: horizontal range of targets. RISE: their largest difference of depth."""
CURRENTS = (0.1, 0.4)
"""[m/s] Range of the speed of currents that a pose is held in."""
PATH_SPEED = 0.25
"""[m/s] Speed of the point that moves along a path."""


class PoseTask(GliderTask):
    """Base of pose tasks. Reward: nearness to a point, half of it for the heading there."""

    goals = MappingProxyType({"target": (3,), "target_heading": (), "speed": (3,)})
    goal_scales = MappingProxyType({"to_target": 2.0, "speed": 0.3, "current": 0.3})
    goals_from = MappingProxyType(
        {"to_target": ("position", "depth", "heading")}
        | dict.fromkeys(("to_heading", "speed", "current"), ("heading",))
    )
    target: Any = (0.0, 0.0, 0.0)
    """[m] North, east and depth of the point."""
    target_heading: Any = 0.0
    """[rad] Heading to hold."""
    speed: Any = (0.0, 0.0, 0.0)
    """[m/s] Velocity of the point, NED."""

    def way(self, pitch: float) -> Way:
        """Rest, at the speed of the vehicle's cruise.

        Raises:
          MissionError: no thrusters hold a pose.
        """
        if not self.vehicle.holds_pose:
            raise MissionError(f"vehicle {self.vehicle.name!r} holds no pose: give {VEHICLE}")
        return Way(0.0, 0.0, self.vehicle.cruise_speed, 0.0, self.vehicle.rest)

    def mark(self, physics: Physics) -> None:
        """Move the marker, a sphere, to the target."""
        place_marker(physics, *self.target)

    def error(self, physics: Physics) -> Array:
        """Vector from the vehicle to the target [m], NED, shape (..., 3)."""
        return np.asarray(self.target) - row(physics.north(), physics.east(), physics.depth())

    def heading_error(self, physics: Physics) -> Any:
        """Target minus present heading [rad], in [-pi, pi)."""
        return wrap_angle(self.target_heading - physics.heading())

    def observe_goal(self, physics: Physics) -> dict[str, Array]:
        """Observe `to_target` [m], `speed` of the target and `current` [m/s], all ahead, to
        starboard of the heading and down; `to_heading`: sine, cosine of the heading error."""
        c, s = np.cos(physics.heading()), np.sin(physics.heading())

        def turned(vector: Any) -> Array:
            north, east = vector[..., 0], vector[..., 1]
            return row(c * north + s * east, c * east - s * north, vector[..., 2])

        return {
            "to_target": turned(self.error(physics)),
            "to_heading": as_direction(self.heading_error(physics)),
            "speed": turned(np.asarray(self.speed)),
            "current": turned(physics.current()),
        }

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Limits of the goal: the longest path of an episode; the fastest current."""
        farthest = self.max_depth + 2.0 * self.fastest * (self.duration + self.period)
        limits = {"to_target": farthest, "to_heading": 1.0, "speed": self.fastest}
        return {name: (-most, most) for name, most in {**limits, "current": self.fastest}.items()}

    def get_reward(self, physics: Physics) -> Any:
        """Reward of 1 at the target pose."""
        distance = np.linalg.norm(self.error(physics), axis=-1)
        near = rewards.tolerance(distance, bounds=(0.0, NEAR), margin=MARGIN, sigmoid="long_tail")
        facing = rewards.tolerance(
            self.heading_error(physics), bounds=(-FACING, FACING), margin=FACING_MARGIN,
            sigmoid="long_tail",
        )  # fmt: skip
        return near * (1.0 + facing) / 2.0

    def reference(self, physics: Physics) -> Reference:
        """Target pose and its velocity."""
        return Reference(
            pitch=0.0, heading=float(self.target_heading), net_mass=0.0,
            position=np.asarray(self.target), velocity=np.asarray(self.speed),
        )  # fmt: skip


class Reach(PoseTask):
    """Reach task: a pose 2 to 6 m away, from rest in still water."""

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """Sample the start at rest and the pose."""
        depth = random.uniform(*START_DEPTHS)
        heading, wanted = random.uniform(0.0, math.tau, size=2)
        target = _draw_target(random, np.array([0.0, 0.0, depth]))
        goal = {"target": target, "target_heading": wanted, "speed": np.zeros(3)}
        return Episode(start=Start(depth=depth, heading=heading), goal=goal)


class Station(PoseTask):
    """Station task: hold the pose of the start in a current from any side."""

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """Sample the pose, where the vehicle is at rest over ground, and the current."""
        depth, speed = random.uniform(*START_DEPTHS), random.uniform(*CURRENTS)
        heading, toward = random.uniform(0.0, math.tau, size=2)
        current = Uniform(north=speed * math.cos(toward), east=speed * math.sin(toward))
        against = (-speed * math.cos(toward - heading), -speed * math.sin(toward - heading), 0.0)
        target = np.array([0.0, 0.0, depth])
        goal = {"target": target, "target_heading": heading, "speed": np.zeros(3)}
        start = Start(depth=depth, heading=heading, v_rel=against)
        return Episode(start=start, goal=goal, current=current)


class Path(PoseTask):
    """Path task: stay at a point that moves along random legs, with the heading of each leg."""

    goals = MappingProxyType({**PoseTask.goals, "leg": (2, 3), "began": ()})
    leg: Any = np.zeros((2, 3))
    """[m] Start and end of the leg: north, east, depth."""
    began: Any = 0.0
    """[s] Time at which the point was at the start of the leg."""

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """Sample the first leg, at whose start the vehicle rests with the leg's heading."""
        begin = np.array([0.0, 0.0, random.uniform(*START_DEPTHS)])
        leg = np.stack([begin, _draw_target(random, begin)])
        goal = _on_leg(leg, 0.0)
        start = Start(depth=begin[2], heading=goal["target_heading"] % math.tau)
        return Episode(start=start, goal=goal)

    def after_step(self, physics: Physics) -> None:
        """Move the point; sample the next leg where it is at the end of one."""
        leg, speed = np.asarray(self.leg), np.asarray(self.speed)
        gone = np.asarray(physics.time()) - self.began
        length = np.linalg.norm(leg[..., 1, :] - leg[..., 0, :], axis=-1)
        self.target = leg[..., 0, :] + speed * gone[..., None]
        for place in np.argwhere(gone * PATH_SPEED >= length):
            at = tuple(place)
            end = leg[(*at, 1)]
            following = np.stack([end, _draw_target(self.generator(at), end)])
            took = float(length[at]) / PATH_SPEED
            began = float(np.asarray(self.began)[at]) + took
            self.put(at, **_on_leg(following, began, float(gone[at]) - took))
        if self.count is None:
            self.mark(physics)
        super().after_step(physics)


def _on_leg(leg: Array, began: float, gone: float = 0.0) -> dict[str, Any]:
    """Goal of a point on a leg (2, 3) that it began at a time [s], `gone` seconds later."""
    along = leg[1] - leg[0]
    heading, speed = math.atan2(along[1], along[0]), PATH_SPEED * along / np.linalg.norm(along)
    target = leg[0] + gone * speed
    return {
        "leg": leg, "began": began, "target": target, "target_heading": heading, "speed": speed
    }  # fmt: skip


def _draw_target(random: np.random.RandomState, begin: Array) -> Array:
    """Sample a point at one of DISTANCES from another [m], NED, within START_DEPTHS -+ RISE."""
    distance, bearing = random.uniform(*DISTANCES), random.uniform(0.0, math.tau)
    low, high = START_DEPTHS[0] - RISE, START_DEPTHS[1] + RISE
    depth = min(max(begin[2] + random.uniform(-RISE, RISE), low), high)
    north, east = distance * math.cos(bearing), distance * math.sin(bearing)
    return np.array([begin[0] + north, begin[1] + east, depth])


def _maker(kind: type[PoseTask], text: str) -> Callable[..., Environment]:
    """Function `text` describes, which makes the environment of a pose task."""

    def make(
        vehicle: str = VEHICLE,
        *,
        random: np.random.RandomState | int | None = None,
        time_limit: float = TIME_LIMIT,
        normalised: bool = True,
        hydrodynamics: str = "coefficients",
        environment_kwargs: Mapping[str, Any] | None = None,
    ) -> Environment:
        rov = load_vehicle(vehicle)
        task = kind(rov, max_depth=MAX_DEPTH, normalised=normalised, random=random)
        marked = with_marker(rov, type="sphere", size="0.15")  # m
        physics = Physics.from_vehicle(marked, hydrodynamics=hydrodynamics)
        return build(physics, task, time_limit=time_limit, settings=environment_kwargs)

    make.__name__ = make.__qualname__ = kind.__name__.lower()
    make.__doc__ = text
    return make


reach = _maker(Reach, "Reach a random pose from rest at another one, in still water.")
station = _maker(Station, "Hold a pose in a random current.")
path = _maker(Path, "Follow a point along random legs, with the heading of each leg.")
