"""Energy: travel far on a course with little energy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from twin.control import rewards
from twin.control.environment import Environment, build
from twin.control.physics import Physics, WaterPhysics
from twin.control.task import Episode, GliderTask, Place, Reference, as_direction, row, wrap_angle
from twin.control.waypoints import yo_sense
from twin.numbers import Array
from twin.vehicle.consumption import Consumption, cost_of_transport
from twin.vehicle.vehicle import load_vehicle

TIME_LIMIT = 3600.0
"""[s]"""
MAX_DEPTH = 200.0
"""[m]"""
START_DEPTHS = (30.0, 60.0)
"""[m]"""
LARGEST_TURN = math.radians(30.0)
"""[rad] between initial heading and course"""
GOOD_COST, COST_MARGIN = 0.004, 0.02
"""Cost of transport that earns reward 1, and beyond it where the reward has fallen to 0.1"""
SETTLING = 30.0
"""[m] of way at GOOD_COST counted before the start, so that the first metres do not decide"""
TURN_DEPTHS = (15.0, 185.0)
"""[m] where the reference turns: deep yos pump seldom"""
KILO = 1e3
MOST_POWER = 2000.0
"""[W] that the parts take at most on an average: limit of the observed energy"""


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
    """Reward: falls with the cost of transport along the course since the start."""

    goals = MappingProxyType({"course": (), "spent": (), "counted": ()})
    goal_scales = MappingProxyType({"distance": 500.0, "spent": 5.0})
    goals_from = MappingProxyType({"to_course": ("heading",), "distance": ("position",)})
    course: Any = 0.0
    """[rad]"""
    spent: Any = 0.0
    """[J] since the start"""
    counted: Any = 0.0
    """[s] time up to which it is counted"""

    def __init__(self, *arguments: Any, consumption: Consumption, **settings: Any):
        super().__init__(*arguments, **settings)
        self.consumption = consumption
        self.before: Any = self.vehicle.rest
        """Positions of the parts up to which energy is counted, (parts,) of each vehicle"""

    def serve(self, generators: Sequence[np.random.RandomState]) -> None:
        """As every task."""
        super().serve(generators)
        self.before = np.tile(self.vehicle.rest, (len(generators), 1))

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """A course and a dive to start from."""
        course = random.uniform(0.0, 2.0 * math.pi)
        heading = (course + random.uniform(-LARGEST_TURN, LARGEST_TURN)) % (2.0 * math.pi)
        depth = random.uniform(*START_DEPTHS)
        start = self.gliding_start(depth=depth, heading=heading, pitch=-self.cruise_pitch)
        return Episode(start=start, goal={"course": course, "spent": 0.0})

    def begin(self, physics: WaterPhysics, at: Place, episode: Episode) -> None:
        """Count from here on."""
        super().begin(physics, at, episode)
        self.put(at, before=physics.activation()[at], counted=np.asarray(physics.time())[at])

    def after_step(self, physics: WaterPhysics) -> None:
        """Count what the step took."""
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

    def distance(self, physics: WaterPhysics) -> Any:
        """Way made along the course since the start [m]."""
        return physics.north() * np.cos(self.course) + physics.east() * np.sin(self.course)

    def heading_error(self, physics: WaterPhysics) -> Any:
        """Course minus heading [rad], in [-pi, pi)."""
        return wrap_angle(self.course - physics.heading())

    def observe_goal(self, physics: WaterPhysics) -> dict[str, Array]:
        """`to_course`: sine and cosine of the heading error; `distance` [m]; `spent` [kJ]."""
        return {
            "to_course": as_direction(self.heading_error(physics)),
            "distance": row(self.distance(physics)),
            "spent": row(self.spent / KILO),
        }

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """How far an episode leads, and MOST_POWER of moves beside the electronics all along."""
        farthest = self.fastest * self.duration
        power = self.consumption.hotel_power + MOST_POWER
        return {
            "to_course": (-1.0, 1.0),
            "distance": (-farthest, farthest),
            "spent": (0.0, power * self.duration / KILO),
        }

    def get_reward(self, physics: WaterPhysics) -> Any:
        """1 at GOOD_COST or less."""
        vehicle = self.vehicle
        credit = GOOD_COST * vehicle.mass * vehicle.gravity * SETTLING
        cost = cost_of_transport(vehicle, self.spent + credit, self.distance(physics) + SETTLING)
        return rewards.tolerance(
            cost, bounds=(0.0, GOOD_COST), margin=COST_MARGIN, sigmoid="long_tail"
        )

    def reference(self, physics: WaterPhysics) -> Reference:
        """Deep yos on the course."""
        sense = yo_sense(physics, self.vehicle, *TURN_DEPTHS)
        return Reference(
            pitch=-sense * self.cruise_pitch, heading=self.course, net_mass=sense * self.cruise_mass
        )
