"""Task: base of all control tasks: actions, observations, and the ends of an episode."""

from __future__ import annotations

import collections
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from twin.control.believed import Believed
from twin.control.conditions import Conditions, Randomiser
from twin.control.observations import UNSHOWN, Noisy
from twin.control.physics import Physics
from twin.errors import InputError, VehicleError
from twin.mission.way import Way
from twin.mission.way import way as steady_way
from twin.numbers import Array, numbers
from twin.physics.start import Start
from twin.vehicle.vehicle import Vehicle
from twin.water.current.base import Current

Observation = collections.OrderedDict[str, Array]
Place = tuple[int, ...]
"""(index,) of one vehicle among many, or () of a single one."""

CRUISE_PITCH = math.radians(35.0)
"""[rad] Pitch of the cruise glide, from which rewards and starts are scaled."""
PROPELLED_PITCH = math.radians(15.0)
"""[rad] Pitch of a propelled vehicle's cruise; its elevator cannot hold a glider's pitch."""
CRUISE_PUMP = 0.5
"""[1] Fraction of the pump's travel used in the cruise glide."""
MARKER = "target"
"""Name of the site that shows the target."""
VEHICLE_SCALES = {
    "attitude": 1.0,  # rad
    "rates": 0.1,  # rad/s
    "velocity": 0.5,  # m/s
    "depth": 100.0,  # m
    "depth_rate": 0.2,  # m/s
    "actuators": 1.0,
    "net_buoyancy": 0.5,  # kg
}
"""Usual sizes of the observations of a vehicle, in their units."""
LARGEST_RATE = 8.0 * math.pi
"""[rad/s] Limit of observed rates: four turns a second; propelled hulls can roll at 0.8 of one."""
FASTEST = 10.0
"""[m/s] Smallest limit of observed speeds."""
FASTEST_CRUISES = 10.0
"""[1] Limit of observed speeds as a multiple of the cruise speed, if that is more."""
LARGEST_FRACTION = 2.0
"""[1] Limit of observed part positions; travel is -1 to 1, and sensors have errors."""
_HULL = "hull"
_REWARDED = np.array([0.15, 0.85, 0.35])
"""Colour of the hull at reward 1, if rewards are shown."""
_COLOUR_POWER = 4
"""Power applied to a reward for the colour, as in dm_control, to distinguish high rewards."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reference:
    """Setpoints of a pilot at this time; the autopilot flies them."""

    pitch: float
    """[rad] Pitch, positive nose up."""
    heading: float | None
    """[rad] Heading; None: any."""
    net_mass: float
    """[kg] Net buoyancy mass, positive = heavy."""
    position: Array | None = None
    """[m] North, east and depth of a pose that thrusters hold; None: no pose."""
    velocity: Array | None = None
    """[m/s] Velocity of that pose, NED; None: it stands."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Episode:
    """Start, goal and current of one sampled episode."""

    start: Start
    """Position, attitude and motion at the start."""
    goal: Mapping[str, Any]
    """Goal values, by the names of `GliderTask.goals`."""
    current: Current | None = None
    """Steady current that belongs to the task; None: no current from the task."""


LARGEST_SEED = 2**31


def episode_random(seed: int, episode: int) -> np.random.RandomState:
    """Random numbers of the `episode`-th reset after `seed`; they depend on nothing else."""
    sequence = np.random.SeedSequence(seed, spawn_key=(episode,))
    return np.random.RandomState(np.random.PCG64(sequence))


NEEDED = (
    ("draw_episode", "initialize_episode"), ("observe_goal", "get_observation"), ("get_reward",)
)  # fmt: skip
"""Methods that a task must have, and those of a single vehicle's task in their place."""


class GliderTask:
    """Base class of control tasks.

    Actions command the vehicle's parts in their order (a glider's: shift, rotation and pump), each
    from -1 to 1 over its travel, or in its own unit with `normalised=False`. The parts follow with
    their lags and rates. An episode ends with discount 0 when the hull breaks the surface or goes
    below `max_depth`.

    A task that implements `draw_episode`, with formulas that take arrays, serves one vehicle or,
    after `serve`, many at once. For many, `physics` is a `twin.control.many.ManyPhysics`, and
    measurements, goals and rewards have the vehicle as their first axis.
    """

    goals: ClassVar[Mapping[str, tuple[int, ...]]] = {}
    """Attributes that an episode sets for each vehicle, and their shapes."""
    goal_scales: ClassVar[Mapping[str, float]] = {}
    """Usual sizes of the observations of `observe_goal`, in their units; others count as 1."""
    goals_from: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Measurements from which each observation of `observe_goal` is computed, and whose noise it
    therefore has: names of the vehicle's observations, `heading` and `position`."""

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        max_depth: float,
        normalised: bool = True,
        random: np.random.RandomState | int | None = None,
    ):
        """Take a vehicle and a depth limit [m].

        Raises:
          InputError: `max_depth` is not positive, or the task lacks a method of NEEDED.
          MissionError: the vehicle cannot cruise.
        """
        kind = type(self)
        same = {name for name in vars(GliderTask) if getattr(kind, name) is vars(GliderTask)[name]}
        if lacking := [names[0] for names in NEEDED if same.issuperset(names)]:
            raise InputError(f"task {kind.__name__} is only half there: write {', '.join(lacking)}")
        if not max_depth > 0:
            raise InputError(f"max_depth {max_depth} m must be positive")
        if not isinstance(normalised, bool):
            raise InputError(f"normalised is {normalised!r}: give True or False")
        if not isinstance(random, np.random.RandomState):
            random = np.random.RandomState(random)
        self.random = random
        """Generator of all random numbers of a single vehicle."""
        self.visualize_reward = False
        """True: colour the hull by the reward."""
        self.vehicle = vehicle
        self.max_depth = float(max_depth)
        self.normalised = normalised
        self._low, self._high = vehicle.actuator_min, vehicle.actuator_max
        self.propelled = vehicle.steered("speed") is not None
        self.cruise_pitch = PROPELLED_PITCH if self.propelled else CRUISE_PITCH
        """[rad] Magnitude of pitch in the cruise."""
        pump = vehicle.steered("buoyancy")
        self.cruise_mass = 0.0
        """[kg] Net buoyancy mass of a cruise down; 0 without a pump or with a propeller."""
        if pump is not None and not self.propelled:
            volume = pump.rest + CRUISE_PUMP * (pump.low - pump.rest)
            self.cruise_mass = vehicle.net_mass_for_pump(float(volume))
        self.cruise = self.way(-self.cruise_pitch)
        self.conditions: Randomiser | None = None
        """Sampler of the vehicle's errors and the water of an episode; None: those of the files."""
        self.duration = math.inf
        """[s] Longest duration of an episode."""
        self.period = math.inf
        """[s] Time between two observations."""
        self.count: int | None = None
        """Number of vehicles served at once; None: a single one, without an axis for it."""
        self._generators: list[np.random.RandomState] = []
        self._colour: Array | None = None
        self.believed: Believed | None = None
        """State estimate behind the observations of a navigated environment; None: the truth."""
        self.noise: Callable[[], Mapping[str, Array]] | None = None
        """Function that returns errors of the observations in progress, by name; None: none."""

    # --- actions ------------------------------------------------------------------------------

    def action_range(self) -> tuple[Array, Array]:
        """Lower and upper limits of actions, (parts,) each, from -1 to 1 or in the parts' units."""
        if not self.normalised:
            return self._low.copy(), self._high.copy()
        return np.full(len(self._low), -1.0), np.full(len(self._low), 1.0)

    def to_command(self, action: ArrayLike) -> Array:
        """Convert an action to commanded positions of the parts, in their order and units.

        Raises:
          InputError: another shape, or a value that is not finite.
        """
        values: Array = numbers(action, "action")
        parts = len(self.vehicle.parts)
        shape = (parts,) if self.count is None else (self.count, parts)
        names = ", ".join(self.vehicle.part_names)
        if values.shape != shape:
            many = "" if self.count is None else f" for each of {self.count} vehicles"
            raise InputError(
                f"action of shape {values.shape} must be of shape {shape}: {names}{many}"
            )
        if not np.isfinite(values).all():
            *vehicle, part = np.argwhere(~np.isfinite(values))[0].tolist()
            whose = f" of vehicle {vehicle[0]}" if vehicle else ""
            raise InputError(
                f"action{whose}: {self.vehicle.part_names[part]} is {values[(*vehicle, part)]}: "
                f"actions must be finite numbers ({names})"
            )
        if not self.normalised:
            return np.clip(values, self._low, self._high)
        fraction = 0.5 * (np.clip(values, -1.0, 1.0) + 1.0)
        return self._low + fraction * (self._high - self._low)

    def to_action(self, command: ArrayLike) -> Array:
        """Convert commanded positions to an action; the inverse of `to_command`."""
        values: Array = np.clip(np.asarray(command, float), self._low, self._high)
        if not self.normalised:
            return values
        return 2.0 * (values - self._low) / (self._high - self._low) - 1.0

    def before_step(self, action: ArrayLike, physics: Physics) -> None:
        """Command the parts."""
        physics.set_control(self.to_command(action))

    # --- episodes -----------------------------------------------------------------------------

    def serve(self, generators: Sequence[np.random.RandomState]) -> None:
        """Serve as many vehicles as there are `generators`, one generator for each.

        Raises:
          InputError: the task can sample episodes for a single vehicle only.
        """
        kind = type(self)
        if kind.draw_episode is GliderTask.draw_episode or (
            kind.initialize_episode is not GliderTask.initialize_episode
        ):
            raise InputError(
                f"task {kind.__name__} serves one vehicle at a time: to serve many, draw its "
                "episodes in draw_episode, and not in initialize_episode"
            )
        self._generators = list(generators)
        self.count = len(self._generators)
        for name, shape in self.goals.items():
            setattr(self, name, np.zeros((self.count, *shape)))

    def generator(self, at: Place) -> np.random.RandomState:
        """Random numbers of one vehicle: `at` is (its index,), or () for a single vehicle."""
        return self._generators[at[0]] if at else self.random

    def set_generator(self, random: np.random.RandomState, at: Place = ()) -> None:
        """Use the generator `random` for a vehicle from now on."""
        if at:
            self._generators[at[0]] = random
        else:
            self.random = random

    def put(self, at: Place, **values: Any) -> None:
        """Set goal attributes of one vehicle."""
        for name, value in values.items():
            if at:
                getattr(self, name)[at] = value
            else:
                setattr(self, name, value)

    def draw_episode(self, random: np.random.RandomState) -> Episode:
        """Sample the start, the goal and the current of one vehicle's episode."""
        raise NotImplementedError

    def initialize_episode(self, physics: Physics) -> None:
        """Sample an episode and start it."""
        episode = self.place(physics, ())
        self.begin(physics, (), episode)
        self.mark(physics)
        self.after_step(physics)

    def place(self, physics: Physics, at: Place) -> Episode:
        """Sample an episode of one vehicle and write its start; call `begin` next."""
        random = self.generator(at)
        episode = self.draw_episode(random)
        conditions = None if self.conditions is None else self.conditions.draw(random)
        if episode.current is not None:
            conditions = (conditions or Conditions()).flowing(episode.current)
        # without a time limit there are only currents of tasks, which are steady
        duration = self.duration if math.isfinite(self.duration) else 1.0
        physics.place(
            at, episode.start, vehicle=self.vehicle, conditions=conditions, duration=duration
        )
        return episode

    def begin(self, physics: Physics, at: Place, episode: Episode) -> None:
        """Take over a placed vehicle's goal; raises InputError for one that `goals` lacks."""
        if lacking := ", ".join(episode.goal.keys() - self.goals.keys()):
            way = "name it in the class with its shape: goals = {NAME: ()}"
            raise InputError(f"task {type(self).__name__} sets the goal {lacking}: {way}")
        self.put(at, **episode.goal)

    def mark(self, physics: Physics) -> None:
        """Move the marker of a task that has one; only called for a single vehicle."""

    def after_step(self, physics: Physics) -> None:
        """Colour the hull by the reward if rewards are shown."""
        if not self.visualize_reward:
            return
        material = physics.mj_model.material(_HULL).id
        colours = physics.mj_model.mat_rgba
        if self._colour is None:
            self._colour = colours[material, :3].copy()
        blend = min(max(self.get_reward(physics), 0.0), 1.0) ** _COLOUR_POWER
        colours[material, :3] = blend * _REWARDED + (1.0 - blend) * self._colour

    def get_termination(self, physics: Physics) -> float | None:
        """Return discount 0 at the surface or below the depth limit, else None."""
        return 0.0 if self.lost(physics) else None

    def lost(self, physics: Physics) -> Any:
        """Tell for each vehicle whether the hull is at the surface or below the depth limit."""
        return (physics.immersion() < 1.0) | (physics.depth() > self.max_depth)

    def way(self, pitch: float) -> Way:
        """Steady motion at `pitch` [rad]: the cruise's glide, or propelled."""
        mass = -math.copysign(self.cruise_mass, pitch)
        return steady_way(
            self.vehicle, "task", "pitch", math.degrees(pitch), mass, None, within_travel=True
        )

    def gliding_start(self, *, depth: float, heading: float, pitch: float) -> Start:
        """Start at the origin in steady motion at `pitch` [rad], depth [m] and heading [rad]."""
        way = self.way(pitch)
        alpha = way.angle_of_attack
        v_rel = (way.speed * math.cos(alpha), 0.0, way.speed * math.sin(alpha))
        actuators = tuple(self.vehicle.allocated(way.command).tolist())
        return Start(depth=depth, heading=heading, pitch=pitch, v_rel=v_rel, actuators=actuators)

    # --- observations -------------------------------------------------------------------------

    def observe_vehicle(self, physics: Physics) -> Observation:
        """Observe the state that a vehicle knows of itself.

        attitude: roll, pitch [rad]; rates: p, q, r [rad/s]; velocity: surge, sway, heave through
        the water [m/s]; depth [m]; depth_rate [m/s]; actuators: fractions of travel, -1 to 1;
        net_buoyancy [kg].
        """
        return collections.OrderedDict(
            attitude=row(physics.roll(), physics.pitch()),
            rates=physics.rates(),
            velocity=physics.velocity_through_water(),
            depth=row(physics.depth()),
            depth_rate=row(physics.depth_rate()),
            actuators=physics.actuators(),
            net_buoyancy=row(physics.net_buoyancy()),
        )

    def get_observation(self, physics: Physics) -> Observation:
        """Observe the vehicle's state, then the goal: from the estimate on board in a navigated
        environment, and with errors if there is noise."""
        seen: Any = physics
        if self.believed is not None:
            self.believed.look(physics)
            seen = self.believed
        errors = {} if self.noise is None else self.noise()
        if errors:
            seen = Noisy(seen, errors)
        observation = self.observe_vehicle(seen)
        observation.update(self.observe_goal(seen))
        for name in errors.keys() & observation.keys() - VEHICLE_SCALES.keys() - UNSHOWN.keys():
            observation[name] = observation[name] + errors[name]  # the others have errors already
        return observation

    def limits(self) -> dict[str, tuple[float, float]]:
        """Limits of the observations without their noise, by name, in their units.

        `fastest` limits speeds and the path of an episode. A depth exceeds the depth limit by one
        control period at most. The net buoyancy is less than the vehicle's mass. Observations that
        are left out have no limit.
        """
        fastest = self.fastest
        margin = fastest * self.period
        return {
            "attitude": (-math.pi, math.pi),
            "rates": (-LARGEST_RATE, LARGEST_RATE),
            "velocity": (-fastest, fastest),
            "depth": (-margin, self.max_depth + margin),
            "depth_rate": (-fastest, fastest),
            "actuators": (-LARGEST_FRACTION, LARGEST_FRACTION),
            "net_buoyancy": (-self.vehicle.mass, self.vehicle.mass),
            **self.goal_limits(),
        }

    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Limits of the observations of `observe_goal` without their noise, by name."""
        return {}

    @property
    def fastest(self) -> float:
        """[m/s] Speed far beyond every vehicle, current and drifting hull."""
        return max(FASTEST, FASTEST_CRUISES * self.cruise.speed)

    def scale(self, name: str) -> float:
        """Usual size of an observation, in its unit; 1 if none is given."""
        return self.goal_scales.get(name, VEHICLE_SCALES.get(name, 1.0))

    def observe_goal(self, physics: Physics) -> dict[str, Array]:
        """Observe the goal relative to the vehicle, by name."""
        raise NotImplementedError

    def get_reward(self, physics: Physics) -> Any:
        """Reward between 0 and 1, for each vehicle."""
        raise NotImplementedError

    def reference(self, physics: Physics) -> Reference:
        """Setpoints of a pilot at this time; raises InputError for a task without."""
        raise InputError(
            f"task {type(self).__name__} has no method reference: no autopilot flies it"
        )


def row(*values: Any) -> Array:
    """Stack numbers of one vehicle to shape (values,), or of many to (vehicles, values)."""
    return np.stack([np.asarray(value, float) for value in values], axis=-1)


def wrap_angle(angle: Any) -> Any:
    """Wrap an angle to [-pi, pi) [rad]."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def as_direction(angle: Any) -> Array:
    """Sine and cosine of an angle [rad], shape (..., 2); they do not jump at a half turn."""
    return row(np.sin(angle), np.cos(angle))


def with_marker(vehicle: Vehicle, **attributes: Any) -> Vehicle:
    """Copy of the vehicle with a translucent site MARKER in its world; sites exert no force.

    Args:
      attributes: attributes of the site, as in MJCF (type, size, ...).

    Raises:
      VehicleError: the file has no world body, or a site of that name.
    """
    root = ElementTree.fromstring(vehicle.xml)
    world = root.find("worldbody")
    if world is None or root.find(f".//site[@name='{MARKER}']") is not None:
        raise VehicleError(
            f"vehicle {vehicle.name!r}: the suite adds a site {MARKER!r} to <worldbody>; the file "
            "needs that element and must not use the name"
        )
    # off the origin, or MuJoCo would fix the site to its body's position for good
    ElementTree.SubElement(
        world, "site", name=MARKER, pos="0 0 -1", rgba="0.2 0.9 0.4 0.3", group="0", **attributes
    )
    return vehicle.replace(xml=ElementTree.tostring(root, encoding="unicode"))


def place_marker(physics: Physics, north: float, east: float, depth: float) -> None:
    """Move the site of `with_marker`, else InputError, to a position [m] in a reset or a step."""
    model, data = physics.mj_model, physics.mj_data
    try:
        marker = model.site(MARKER).id
    except KeyError as error:
        way = "make the physics of with_marker(vehicle, type='cylinder', size='40 0.05')"
        raise InputError(f"the physics has no site {MARKER!r}: {way}") from error
    model.site_pos[marker] = (north, -east, -depth)
    data.site_xpos[marker] = (north, -east, -depth)  # seen before the next step
