"""Waypoints: fly from waypoint to waypoint in a current."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control.utils import rewards

from twin.suite.environment import Environment, build
from twin.suite.physics import Physics
from twin.suite.task import (
    Array,
    GliderTask,
    Reference,
    place_marker,
    with_marker,
)
from twin.vehicle.vehicle import Vehicle, load_vehicle
from twin.water.current.profile import Profile

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

    target = (0.0, 0.0)
    """North and east of the waypoint [m]"""
    reached = 0
    """Waypoints reached in this episode"""

    def __init__(self, *arguments: Any, **settings: Any):
        super().__init__(*arguments, **settings)
        cruise = self.cruise
        self.cruise_progress = math.sqrt(cruise.speed**2 - cruise.vertical_speed**2)

    def initialize_episode(self, physics: Physics) -> None:
        """Draw the current, the first waypoint and the heading of a dive to start from."""
        strongest = STRONGEST_CURRENT * self.cruise_progress
        speed = self.random.uniform(0.2 * strongest, strongest, size=2)
        toward = self.random.uniform(0.0, 2.0 * math.pi) + np.array([0.0, 1.0]) * (
            self.random.uniform(-0.5 * math.pi, 0.5 * math.pi)
        )
        current = Profile(
            depth=(0.0, self.max_depth),
            north=tuple(speed * np.cos(toward)),
            east=tuple(speed * np.sin(toward)),
        )
        physics.set_current(current, duration=1.0)  # steady: any duration
        self.start_gliding(
            physics,
            depth=START_DEPTH,
            heading=self.random.uniform(0.0, 2.0 * math.pi),
            pitch=-self.cruise_pitch,
        )
        self.reached = 0
        self._draw_waypoint(physics)
        super().initialize_episode(physics)

    def _draw_waypoint(self, physics: Physics) -> None:
        distance = self.random.uniform(*LEGS)
        bearing = self.random.uniform(0.0, 2.0 * math.pi)
        north = physics.north() + distance * math.cos(bearing)
        east = physics.east() + distance * math.sin(bearing)
        self.target = (north, east)
        place_marker(physics, north, east, 0.5 * self.max_depth)

    def after_step(self, physics: Physics) -> None:
        """Put up the next waypoint when this one is reached."""
        if math.hypot(*self.to_target(physics)) < RADIUS:
            self.reached += 1
            self._draw_waypoint(physics)
        super().after_step(physics)

    def to_target(self, physics: Physics) -> tuple[float, float]:
        """North and east from the glider to the waypoint [m]."""
        return self.target[0] - physics.north(), self.target[1] - physics.east()

    def observe_goal(self, physics: Physics) -> dict[str, Array]:
        """`to_target` [m] and `current` [m/s], each ahead and to starboard of the heading."""
        c, s = math.cos(physics.heading()), math.sin(physics.heading())
        turn = np.array([[c, s], [-s, c]])
        return {
            "to_target": turn @ self.to_target(physics),
            "current": turn @ physics.current()[:2],
        }

    def get_reward(self, physics: Physics) -> float:
        """Progress over ground in units of the cruise's, from 0 to 1."""
        to_target = np.array(self.to_target(physics))
        velocity = physics.velocity_over_ground()[:2]
        progress = float(velocity @ to_target) / float(np.linalg.norm(to_target))
        return float(
            rewards.tolerance(
                progress,
                bounds=(self.cruise_progress, math.inf),
                margin=self.cruise_progress,
                sigmoid="linear",
                value_at_margin=0.0,
            )
        )

    def reference(self, physics: Physics) -> Reference:
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


def yo_sense(physics: Physics, vehicle: Vehicle, shallow: float, deep: float) -> float:
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
    return 1.0 if physics.data.ctrl[vehicle.part_names.index(pump.name)] < pump.rest else -1.0
