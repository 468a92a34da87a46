"""Published motions: numbers that a vehicle file must reproduce, from assets/published.toml.

They include steady motions of propelled vehicles that a rudder or an elevator holds.
"""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, NoSteadyState, unknown_name
from twin.fossen import FossenModel
from twin.fossen.steady import SteadyProblem
from twin.physics.settle import LockedGlider
from twin.vehicle.presets import asset_path
from twin.vehicle.steady_motion import Trim, solve_steady_state, trim_positions
from twin.vehicle.vehicle import Vehicle

ANGLES = ("angle_of_attack", "sideslip", "roll", "pitch")
FIGURES = {
    "speed": "speed_m_s",
    **{name: f"{name}_deg" for name in ANGLES},
    "turn_rate": "turn_rate_rad_s",
    "vertical_speed": "vertical_speed_m_s",
}
"""Field of `Trim` by the name of a published number."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedMotion:
    """Steady motion in print; None for a number that was not published."""

    vehicle: str
    source: str
    speed: float | None = None
    """Speed through the water [m/s]."""
    angle_of_attack: float | None = None
    """Angle of attack [deg]."""
    sideslip: float | None = None
    """Sideslip [deg]."""
    roll: float | None = None
    """Roll [deg]."""
    pitch: float | None = None
    """Pitch [deg]."""
    turn_rate: float | None = None
    """Turn rate about the vertical [rad/s]."""
    vertical_speed: float | None = None
    """Vertical speed, positive down [m/s]."""
    tolerance: dict[str, float]
    """Tolerances: speed, vertical_speed [m/s], angle [deg], turn_rate [rad/s]."""

    def differences(self, trim: Trim) -> dict[str, float]:
        """Differences, computed minus published, of each published number."""
        printed = {name: getattr(self, name) for name in FIGURES}
        return {
            name: getattr(trim, FIGURES[name]) - value
            for name, value in printed.items()
            if value is not None
        }

    def violations(self, trim: Trim) -> list[str]:
        """Texts, one for each number beyond its tolerance."""
        return [
            f"{name} off by {value:.4g} (allowed {self._limit(name):.4g})"
            for name, value in self.differences(trim).items()
            if abs(value) > self._limit(name)
        ]

    def _limit(self, name: str) -> float:
        return self.tolerance["angle" if name in ANGLES else name]


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedGlide(PublishedMotion):
    """Glide or spiral at fixed positions of a glider's battery and pump."""

    net_mass: float
    """Net buoyancy mass [kg]."""
    shift: float
    """Battery shift [m]."""
    rotation: float
    """Battery rotation [deg]."""

    @property
    def rotation_rad(self) -> float:
        """Battery rotation [rad]."""
        return math.radians(self.rotation)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedFlight(PublishedMotion):
    """Propelled motion in which an elevator keeps the depth or a pitch."""

    positions: Mapping[str, float]
    """Positions of parts by name, in their units; a missing rudder position: straight motion."""
    held_pitch: float | None = None
    """Pitch that the elevator holds [deg]; None: it keeps the depth."""

    def request(self, turning: str) -> dict[str, Any]:
        """Arguments of `held_flight`; `turning` is the name of the turning part."""
        return {
            "positions": self.positions,
            "pitch": None if self.held_pitch is None else math.radians(self.held_pitch),
            "turning": turning in self.positions,
        }


Motion = TypeVar("Motion", bound=PublishedMotion)


def published_glides(vehicle: str | None = None) -> list[PublishedGlide]:
    """Published glides of all vehicles, or of one shipped vehicle."""
    return _entries("glide", PublishedGlide, vehicle)


def published_flights(vehicle: str | None = None) -> list[PublishedFlight]:
    """Published propelled motions of all vehicles, or of one shipped vehicle."""
    return _entries("flight", PublishedFlight, vehicle)


def _entries(table: str, kind: type[Motion], vehicle: str | None) -> list[Motion]:
    with asset_path("published.toml").open("rb") as file:
        found = [kind(**entry) for entry in tomllib.load(file)[table]]
    return [motion for motion in found if vehicle is None or motion.vehicle == vehicle]


Array = NDArray[np.float64]
Acceleration = Callable[[Array, Array], Array]

MODELS = ("mujoco", "fossen")
SPEEDS = (1.0, 0.5, 2.0)
"""[m/s] Speeds from which a solution is sought."""
TURNS = (0.0, 0.05, -0.05, 0.15, -0.15)
"""[rad/s] Turn rates from which a solution is sought, if the vehicle turns."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeldFlight:
    """Steady motion, and the positions of the parts that hold it."""

    trim: Trim
    held: Mapping[str, float]
    """Positions of the controlling parts, by name, in their units."""


def held_flight(
    vehicle: Vehicle,
    positions: Mapping[str, float],
    *,
    pitch: float | None = None,
    turning: bool = False,
    model: str = "mujoco",
) -> HeldFlight:
    """Find the steady motion at `positions`, with the elevator and rudder that hold it.

    Args:
      positions: of parts by name, in their units; other parts rest, or hold the motion.
      pitch: [rad] that the pitching part holds; None: it keeps the depth.
      turning: True: the turning part stays where `positions` have it; False: it keeps the motion
        straight.
      model: one of MODELS.

    Raises:
      InputError: an unknown model or part, or a vehicle without a part that can hold the motion.
      NoSteadyState: no such motion exists within the travel of the parts.
    """
    if model not in MODELS:
        raise InputError(unknown_name("model", model, MODELS))
    steers = ("pitch",) if turning else ("pitch", "heading")
    for control in steers:
        if control not in vehicle.steering:
            raise InputError(f"vehicle {vehicle.name!r} has nothing to hold its {control} with")
    at = trim_positions(vehicle, positions=positions)
    leads = [vehicle.steering[control] for control in steers]
    places = [vehicle.part_names.index(name) for name in leads]
    accelerate = _ACCELERATIONS[model](vehicle, at)

    def unpacked(x: Array) -> tuple[Array, Array]:
        motion, now = np.zeros(6), at.copy()
        motion[:5] = x[:5]
        motion[5] = x[6] if turning else 0.0
        now[places] = x[5:6] if turning else x[5:7]
        return motion, now

    def residual(x: Array) -> Array:
        motion, now = unpacked(x)
        now = vehicle.allocated(now, leads)
        u, v, w, roll, nose = motion[:5]
        down = np.cos(nose) * (np.sin(roll) * v + np.cos(roll) * w) - np.sin(nose) * u
        return np.array([*accelerate(motion, now), down if pitch is None else nose - pitch])

    start = 0.0 if pitch is None else pitch
    guesses = [
        np.array([speed, 0.0, 0.0, 0.0, start, 0.0, turn])
        for speed in SPEEDS
        for turn in (TURNS if turning else TURNS[:1])
    ]
    request = ", ".join(f"{name} {vehicle.part(name).text(x)}" for name, x in positions.items())
    found = [unpacked(x) for x in solve_steady_state(residual, guesses) if x[0] > 0.0]
    low, high = vehicle.actuator_min, vehicle.actuator_max
    within = [(x, now) for x, now in found if np.all((now >= low) & (now <= high))]
    if not within:
        names = " and ".join(vehicle.part_names[k] for k in places)
        raise NoSteadyState(
            f"vehicle {vehicle.name!r} at {request}: no steady flight that {names} can hold; turn "
            "or pitch it less, or drive it faster"
        )
    motion, now = min(within, key=lambda one: float(np.abs(one[0][1:5]).sum()))
    trim = Trim.from_motion(
        v_rel=motion[:3],
        roll=motion[3],
        pitch=motion[4],
        turn_rate=motion[5],
        linear_angle=vehicle.law.valid_angle,
    )
    held = {*leads, *(follower.part for follower in vehicle.followers if follower.lead in leads)}
    real = dict(zip(vehicle.part_names, vehicle.allocated(now, leads).tolist(), strict=True))
    return HeldFlight(trim=trim, held={name: x for name, x in real.items() if name in held})


def _mujoco(vehicle: Vehicle, at: Array) -> Acceleration:
    glider = LockedGlider(vehicle, "coefficients", at)

    def accelerate(motion: Array, positions: Array) -> Array:
        glider.data.act[:] = glider.data.ctrl[:] = positions
        return glider.residual(motion)

    return accelerate


def _fossen(vehicle: Vehicle, at: Array) -> Acceleration:
    parameters = FossenModel(vehicle).parameters
    return lambda motion, positions: SteadyProblem(parameters, positions, None, True).residual(
        motion
    )


_ACCELERATIONS = {"mujoco": _mujoco, "fossen": _fossen}
