"""Waypoints: tasks flown in yos: reach waypoints in a current, or go far on little energy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from twin.control import rewards
from twin.control.environment import Environment, build
from twin.control.physics import Physics
from twin.control.task import (
    Episode,
    GliderTask,
    Place,
    Reference,
    as_direction,
    place_marker,
    row,
    with_marker,
    wrap_angle,
)
from twin.numbers import Array
from twin.vehicle.consumption import Consumption, cost_of_transport
from twin.vehicle.vehicle import Vehicle, load_vehicle
from twin.water.current.profile import Profile

Pair = tuple[float, float]

TIME_LIMIT, MAX_DEPTH = 3600.0, 200.0
"""TIME_LIMIT: [s] duration of an episode. MAX_DEPTH: [m] limit of depth."""
START_DEPTH = 50.0
"""[m] Depth of the start."""
LEGS = (150.0, 400.0)
"""[m] Range of horizontal distances between waypoints."""
RADIUS = 20.0
"""[m] Horizontal distance within which a waypoint is reached, at any depth."""
STRONGEST_CURRENT = 0.5
"""[1] Largest current / horizontal cruise speed; below 1, every waypoint is reachable."""
YO_TURNS = (25.0, 150.0)
"""[m] Depths at which the reference turns from climb to dive and back."""


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
    """Waypoint task. Reward: speed over ground toward the waypoint; 1 at the cruise's speed."""

    goals = MappingProxyType({"target": (2,), "reached": ()})
    goal_scales = MappingProxyType({"to_target": 200.0, "current": 0.2})
    goals_from = MappingProxyType({"to_target": ("position", "heading"), "current": ("heading",)})
    target: Any = (0.0, 0.0)
    """Position of the waypoint, north and east [m]."""
    reached: Any = 0
    """Number of waypoints reached in this episode."""

    def __init__(self, *arguments: Any, **settings: Any):
        super().__init__(*arguments, **settings)
        cruise = self.cruise
        self.cruise_progress = math.sqrt(cruise.speed**2 - cruise.vertical_speed**2)

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """Sample the current, the first waypoint and the heading of the dive at the start."""
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

    def mark(self, physics: Physics) -> None:
        """Move the marker, a column, to the waypoint."""
        place_marker(physics, self.target[0], self.target[1], 0.5 * self.max_depth)

    def after_step(self, physics: Physics) -> None:
        """Sample the next waypoint if this one is reached."""
        near = np.hypot(*self.to_target(physics)) < RADIUS
        north, east, reached = (
            np.asarray(v) for v in (physics.north(), physics.east(), self.reached)
        )
        for place in np.argwhere(near):  # few vehicles: a leg takes minutes
            at = tuple(place)
            target = _draw_waypoint(self.generator(at), float(north[at]), float(east[at]))
            self.put(at, target=target, reached=reached[at] + 1)
            if not at:
                self.mark(physics)
        super().after_step(physics)

    def to_target(self, physics: Physics) -> tuple[Any, Any]:
        """Vector from the glider to the waypoint, north and east [m]."""
        target = np.asarray(self.target)
        return target[..., 0] - physics.north(), target[..., 1] - physics.east()

    def observe_goal(self, physics: Physics) -> dict[str, Array]:
        """Observe `to_target` [m] and `current` [m/s], ahead and to starboard of the heading."""
        c, s = np.cos(physics.heading()), np.sin(physics.heading())

        def ahead_and_starboard(north: Any, east: Any) -> Array:
            return row(c * north + s * east, c * east - s * north)

        current = physics.current()
        return {
            "to_target": ahead_and_starboard(*self.to_target(physics)),
            "current": ahead_and_starboard(current[..., 0], current[..., 1]),
        }

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Limits of the goal: a leg plus the longest path of an episode; the fastest current."""
        farthest = LEGS[1] + self.fastest * self.duration
        return {"to_target": (-farthest, farthest), "current": (-self.fastest, self.fastest)}

    def get_reward(self, physics: Physics) -> Any:
        """Progress over ground as a fraction of the cruise's, from 0 to 1."""
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

    def reference(self, physics: Physics) -> Reference:
        """Yo on a heading that corrects for the current's drift on the way to the waypoint."""
        north, east = self.to_target(physics)
        bearing = math.atan2(east, north)
        current = physics.current()
        across = -current[0] * math.sin(bearing) + current[1] * math.cos(bearing)
        lead = math.asin(min(max(across / self.cruise_progress, -1.0), 1.0))
        sense = yo_sense(physics, self.vehicle, *YO_TURNS)
        return Reference(
            pitch=-sense * self.cruise_pitch,
            heading=bearing - lead,
            net_mass=sense * self.cruise_mass,
        )


def _draw_waypoint(random: np.random.RandomState, north: float, east: float) -> Pair:
    """Sample the waypoint after a position, north and east [m]."""
    distance, bearing = random.uniform(*LEGS), random.uniform(0.0, 2.0 * math.pi)
    return north + distance * math.cos(bearing), east + distance * math.sin(bearing)


def yo_sense(physics: Physics, vehicle: Vehicle, shallow: float, deep: float) -> float:
    """Return +1 to dive or -1 to climb, between two depths [m].

    Between them the commanded pump gives the present direction; without a pump, the pitch.
    """
    if physics.depth() >= deep:
        return -1.0
    if physics.depth() <= shallow:
        return 1.0
    pump = vehicle.steered("buoyancy")
    if pump is None:
        return 1.0 if physics.pitch() < 0.0 else -1.0
    return 1.0 if physics.mj_data.ctrl[vehicle.part_names.index(pump.name)] < pump.rest else -1.0


START_DEPTHS = (30.0, 60.0)
"""[m] Range of depths at the start."""
LARGEST_TURN = math.radians(30.0)
"""[rad] Largest angle between initial heading and course."""
GOOD_COST, COST_MARGIN = 0.004, 0.02
"""[1] Cost of transport. GOOD_COST: with reward 1. COST_MARGIN: excess with reward 0.1."""
SETTLING = 30.0
"""[m] Distance at GOOD_COST credited at the start, so that the first metres do not decide."""
DEEP_TURNS = (15.0, 185.0)
"""[m] Depths at which the reference turns: deep yos need the pump rarely."""
KILO = 1e3
MOST_POWER = 2000.0
"""[W] Largest mean power of the parts, for the limit of the observed energy."""


def energy(
    vehicle: str = "glider",
    *,
    random: np.random.RandomState | int | None = None,
    time_limit: float = TIME_LIMIT,
    normalised: bool = True,
    hydrodynamics: str = "coefficients",
    consumption: Consumption | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
) -> Environment:
    """Go far on a random course at a low cost of transport, pump and battery moves included."""
    glider = load_vehicle(vehicle)
    physics = Physics.from_vehicle(glider, hydrodynamics=hydrodynamics)
    task = Energy(
        glider,
        consumption=consumption or Consumption.of(glider),
        max_depth=MAX_DEPTH,
        normalised=normalised,
        random=random,
    )
    return build(physics, task, time_limit=time_limit, settings=environment_kwargs)


class Energy(GliderTask):
    """Energy task. Reward: decreases with the cost of transport along the course so far."""

    goals = MappingProxyType({"course": (), "spent": (), "counted": ()})
    goal_scales = MappingProxyType({"distance": 500.0, "spent": 5.0})
    goals_from = MappingProxyType({"to_course": ("heading",), "distance": ("position",)})
    course: Any = 0.0
    """[rad] Heading of the course."""
    spent: Any = 0.0
    """[J] Energy used since the start."""
    counted: Any = 0.0
    """[s] Time up to which energy has been counted."""

    def __init__(self, *arguments: Any, consumption: Consumption, **settings: Any):
        super().__init__(*arguments, **settings)
        self.consumption = consumption
        self.before: Any = self.vehicle.rest
        """Positions of the parts at the last count of energy, (parts,) for each vehicle."""

    def serve(self, generators: Sequence[np.random.RandomState]) -> None:
        """Serve as many vehicles as there are `generators`, as every task does."""
        super().serve(generators)
        self.before = np.tile(self.vehicle.rest, (len(generators), 1))

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """Sample a course and the dive at the start."""
        course = random.uniform(0.0, 2.0 * math.pi)
        heading = (course + random.uniform(-LARGEST_TURN, LARGEST_TURN)) % (2.0 * math.pi)
        depth = random.uniform(*START_DEPTHS)
        start = self.gliding_start(depth=depth, heading=heading, pitch=-self.cruise_pitch)
        return Episode(start=start, goal={"course": course, "spent": 0.0})

    def begin(self, physics: Physics, at: Place, episode: Episode) -> None:
        """Start an episode and the count of energy."""
        super().begin(physics, at, episode)
        self.put(at, before=physics.activation()[at], counted=np.asarray(physics.time())[at])

    def after_step(self, physics: Physics) -> None:
        """Add the energy of the step."""
        after, time = physics.activation(), physics.time()
        shares = self.consumption.shares(
            self.vehicle,
            self.before,
            after,
            depth=physics.depth(),
            pitch=physics.pitch(),
            duration=time - self.counted,
            speed=physics.velocity_through_water()[..., 0],
        )
        self.spent = self.spent + sum(shares.values())
        self.before, self.counted = after, time
        super().after_step(physics)

    def distance(self, physics: Physics) -> Any:
        """Distance made along the course since the start [m]."""
        return physics.north() * np.cos(self.course) + physics.east() * np.sin(self.course)

    def heading_error(self, physics: Physics) -> Any:
        """Course minus heading [rad], in [-pi, pi)."""
        return wrap_angle(self.course - physics.heading())

    def observe_goal(self, physics: Physics) -> dict[str, Array]:
        """Observe `to_course`: sine, cosine of the heading error; `distance` [m]; `spent` [kJ]."""
        return {
            "to_course": as_direction(self.heading_error(physics)),
            "distance": row(self.distance(physics)),
            "spent": row(self.spent / KILO),
        }

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Limits of the goal: longest path; MOST_POWER plus electronics for a whole episode."""
        farthest = self.fastest * self.duration
        power = self.consumption.hotel_power + MOST_POWER
        return {
            "to_course": (-1.0, 1.0),
            "distance": (-farthest, farthest),
            "spent": (0.0, power * self.duration / KILO),
        }

    def get_reward(self, physics: Physics) -> Any:
        """Reward from the cost of transport; 1 at GOOD_COST or less."""
        vehicle = self.vehicle
        credit = GOOD_COST * vehicle.mass * vehicle.gravity * SETTLING
        cost = cost_of_transport(vehicle, self.spent + credit, self.distance(physics) + SETTLING)
        return rewards.tolerance(
            cost, bounds=(0.0, GOOD_COST), margin=COST_MARGIN, sigmoid="long_tail"
        )

    def reference(self, physics: Physics) -> Reference:
        """Deep yo on the course."""
        sense = yo_sense(physics, self.vehicle, *DEEP_TURNS)
        return Reference(
            pitch=-sense * self.cruise_pitch, heading=self.course, net_mass=sense * self.cruise_mass
        )
