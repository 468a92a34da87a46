"""Waypoints: fly from waypoint to waypoint in a current."""

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
from twin.vehicle.vehicle import Vehicle, load_vehicle
from twin.water.current.profile import Profile

Pair = tuple[float, float]

TIME_LIMIT = 3600.0
"""[s]"""
MAX_DEPTH = 200.0
"""[m]"""
START_DEPTH = 50.0
"""[m]"""
LEGS = (150.0, 400.0)
"""[m] horizontal distances between waypoints"""
RADIUS = 20.0
"""[m] horizontal distance within which a waypoint is reached, at any depth"""
STRONGEST_CURRENT = 0.5
"""Part of the cruise's horizontal speed: every waypoint can be reached"""
TURN_DEPTHS = (25.0, 150.0)
"""[m] where the reference turns from climb to dive and back"""


def waypoints(
    vehicle: str = "glider",
    *,
    random: np.random.RandomState | int | None = None,
    time_limit: float = TIME_LIMIT,
    normalised: bool = True,
    hydrodynamics: str = "coefficients",
    environment_kwargs: Mapping[str, Any] | None = None,
) -> Environment:
    """Follow an endless course of random waypoints in a random current that changes with depth."""
    glider = load_vehicle(vehicle)
    marked = with_marker(glider, type="cylinder", size=f"{RADIUS} {MAX_DEPTH / 2}")
    physics = Physics.from_vehicle(marked, hydrodynamics=hydrodynamics)
    task = Waypoints(glider, max_depth=MAX_DEPTH, normalised=normalised, random=random)
    return build(physics, task, time_limit=time_limit, settings=environment_kwargs)


class Waypoints(GliderTask):
    """Reward: speed over ground toward the waypoint, 1 at the cruise's horizontal speed."""

    goals = MappingProxyType({"target": (2,), "reached": ()})
    goal_scales = MappingProxyType({"to_target": 200.0, "current": 0.2})
    goals_from = MappingProxyType({"to_target": ("position", "heading"), "current": ("heading",)})
    target: Any = (0.0, 0.0)
    """North and east of the waypoint [m]"""
    reached: Any = 0
    """Waypoints reached in this episode"""

    def __init__(self, *arguments: Any, **settings: Any):
        super().__init__(*arguments, **settings)
        cruise = self.cruise
        self.cruise_progress = math.sqrt(cruise.speed**2 - cruise.vertical_speed**2)

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """The current, the heading of a dive to start from and the first waypoint."""
        strongest = STRONGEST_CURRENT * self.cruise_progress
        speed = random.uniform(0.2 * strongest, strongest, size=2)
        toward = random.uniform(0.0, 2.0 * math.pi) + np.array([0.0, 1.0]) * (
            random.uniform(-0.5 * math.pi, 0.5 * math.pi)
        )
        current = Profile(
            depth=(0.0, self.max_depth),
            north=tuple(speed * np.cos(toward)),
            east=tuple(speed * np.sin(toward)),
        )
        heading = random.uniform(0.0, 2.0 * math.pi)
        start = self.gliding_start(depth=START_DEPTH, heading=heading, pitch=-self.cruise_pitch)
        target = _draw_waypoint(random, start.north, start.east)
        return Episode(start=start, goal={"target": target, "reached": 0}, current=current)

    def mark(self, physics: WaterPhysics) -> None:
        """A column at the waypoint."""
        place_marker(physics, self.target[0], self.target[1], 0.5 * self.max_depth)

    def after_step(self, physics: WaterPhysics) -> None:
        """Put up the next waypoint when this one is reached."""
        near = np.hypot(*self.to_target(physics)) < RADIUS
        north, east, reached = (
            np.asarray(v) for v in (physics.north(), physics.east(), self.reached)
        )
        for place in np.argwhere(near):  # few: a leg takes minutes
            at = tuple(place)
            target = _draw_waypoint(self.generator(at), float(north[at]), float(east[at]))
            self.put(at, target=target, reached=reached[at] + 1)
            if not at:
                self.mark(physics)
        super().after_step(physics)

    def to_target(self, physics: WaterPhysics) -> tuple[Any, Any]:
        """North and east from the glider to the waypoint [m]."""
        target = np.asarray(self.target)
        return target[..., 0] - physics.north(), target[..., 1] - physics.east()

    def observe_goal(self, physics: WaterPhysics) -> dict[str, Array]:
        """`to_target` [m] and `current` [m/s], each ahead and to starboard of the heading."""
        c, s = np.cos(physics.heading()), np.sin(physics.heading())

        def ahead_and_starboard(north: Any, east: Any) -> Array:
            return row(c * north + s * east, c * east - s * north)

        current = physics.current()
        return {
            "to_target": ahead_and_starboard(*self.to_target(physics)),
            "current": ahead_and_starboard(current[..., 0], current[..., 1]),
        }

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """A leg, and how far an episode leads."""
        farthest = LEGS[1] + self.fastest * self.duration
        return {"to_target": (-farthest, farthest), "current": (-self.fastest, self.fastest)}

    def get_reward(self, physics: WaterPhysics) -> Any:
        """Progress over ground in units of the cruise's, from 0 to 1."""
        north, east = self.to_target(physics)
        velocity = physics.velocity_over_ground()
        progress = (velocity[..., 0] * north + velocity[..., 1] * east) / np.hypot(north, east)
        return rewards.tolerance(
            progress,
            bounds=(self.cruise_progress, math.inf),
            margin=self.cruise_progress,
            sigmoid="linear",
            value_at_margin=0.0,
        )

    def reference(self, physics: WaterPhysics) -> Reference:
        """A yo on the heading whose drift in the current leads to the waypoint."""
        north, east = self.to_target(physics)
        bearing = math.atan2(east, north)
        current = physics.current()
        across = -current[0] * math.sin(bearing) + current[1] * math.cos(bearing)
        lead = math.asin(min(max(across / self.cruise_progress, -1.0), 1.0))
        sense = yo_sense(physics, self.vehicle, *TURN_DEPTHS)
        return Reference(
            pitch=-sense * self.cruise_pitch,
            heading=bearing - lead,
            net_mass=sense * self.cruise_mass,
        )


def _draw_waypoint(random: np.random.RandomState, north: float, east: float) -> Pair:
    """North and east [m] of the waypoint after a place."""
    distance, bearing = random.uniform(*LEGS), random.uniform(0.0, 2.0 * math.pi)
    return north + distance * math.cos(bearing), east + distance * math.sin(bearing)


def yo_sense(physics: WaterPhysics, vehicle: Vehicle, shallow: float, deep: float) -> float:
    """+1 to dive, -1 to climb, between two depths [m].

    The commanded pump remembers it; of a vehicle without one, the pitch does.
    """
    if physics.depth() >= deep:
        return -1.0
    if physics.depth() <= shallow:
        return 1.0
    pump = vehicle.steered("buoyancy")
    if pump is None:
        return 1.0 if physics.pitch() < 0.0 else -1.0
    return 1.0 if physics.mj_data.ctrl[vehicle.part_names.index(pump.name)] < pump.rest else -1.0
