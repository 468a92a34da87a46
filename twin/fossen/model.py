"""Model: simulate and trim a vehicle with Fossen's equations, without MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import InputError, MissionError, SimulationUnstable
from twin.fossen.equations import NU_R, POSITION, QUATERNION, integrate
from twin.fossen.forces import ForceParameters, parameters_of, temperature_at
from twin.fossen.steady import SteadyMotion, SteadyProblem, stable_motion
from twin.frames import euler_to_quaternion, quaternion_to_euler, quaternion_to_matrix
from twin.mission.controller import Schedule
from twin.numbers import Array
from twin.vehicle.steady_motion import (
    Trim,
    advice,
    driven,
    positions_text,
    require_drive,
    trim_positions,
)
from twin.vehicle.vehicle import Vehicle
from twin.water.current.sampler import sample

Density = Callable[[Array], ArrayLike] | tuple[ArrayLike, ArrayLike]
DEFAULT_DT = 0.05
"""[s] Default fixed step. Compared with steps of 0.0125 s, a run of 600 s with random commands in a
sheared current differs by at most 2e-7 m/s in speed and 3e-5 m in position."""
DENSITY_TABLE = np.linspace(0.0, 2000.0, 2001)
"""[m] Depths at which a density function is tabulated, to the test depth of deep gliders."""


def finite(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return `values` as a finite float array of `shape`, or raise InputError with its name."""
    array = np.array(values, dtype=np.float64)
    if array.shape != shape or not np.all(np.isfinite(array)):
        raise InputError(f"{name} must be finite with shape {shape}, not {values!r}")
    return array


@dataclass(frozen=True, kw_only=True)
class FossenState:
    """Start of a simulation: at rest at the origin unless given."""

    time: float = 0.0
    """[s] Time of the start, at which the current is sampled first."""
    position_ned: ArrayLike = (0.0, 0.0, 0.0)
    """[m] Position of the CB, shape (3,): north, east, depth."""
    attitude: ArrayLike = (0.0, 0.0, 0.0)
    """[rad] Roll, pitch, heading, shape (3,)."""
    v_rel: ArrayLike = (0.0, 0.0, 0.0)
    """[m/s] Velocity of the CB through the water, shape (3,), body FRD."""
    rates: ArrayLike = (0.0, 0.0, 0.0)
    """[rad/s] Rates p, q, r, shape (3,), body FRD."""
    actuators: ArrayLike = ()
    """Positions of the parts, shape (parts,), in their units; empty: all at rest."""

    def __post_init__(self) -> None:
        finite("time", self.time, ())
        shapes = dict.fromkeys(("position_ned", "attitude", "v_rel", "rates"), (3,))
        for name, shape in {**shapes, "actuators": (np.size(self.actuators),)}.items():
            object.__setattr__(self, name, finite(name, getattr(self, name), shape))


@dataclass(frozen=True, kw_only=True, eq=False)
class FossenTrajectory:
    """A simulated track, sampled; every array has the samples along its first axis."""

    time: Array
    """[s] Times of the samples, shape (n,)."""
    position_ned: Array
    """[m] Positions of the CB, NED, shape (n, 3)."""
    quaternion: Array
    """Quaternions, scalar first, body to NED, shape (n, 4)."""
    v_rel: Array
    """[m/s] Velocities through the water, shape (n, 3), body FRD."""
    rates: Array
    """[rad/s] Rates p, q, r, shape (n, 3), body FRD."""
    actuators: Array
    """Positions of the parts in their units, for a glider shift [m], rotation [rad], pump [cm3];
    shape (n, parts)."""
    current_ned: Array
    """[m/s] Currents at the CB, NED, shape (n, 3)."""
    velocity_ned: Array
    """[m/s] Velocities of the CB over ground, NED, shape (n, 3)."""

    @property
    def attitude(self) -> Array:
        """Roll, pitch, heading [rad], shape (n, 3); heading in [0, 2 pi)."""
        return np.stack(quaternion_to_euler(self.quaternion), axis=-1)

    @property
    def speed(self) -> Array:
        """Speed through the water [m/s], shape (n,)."""
        return np.linalg.norm(self.v_rel, axis=-1)


class FossenModel:
    """Independent 6-DOF model of one vehicle in one current and one water column.

    `current_program` is a compiled current (`Current.compile`), None for still water. `density` is
    None (the vehicle's reference density), a function of depth [m] that returns kg/m3 (tabulated
    every metre to 2000 m), or a table (depths, densities), linear in between and constant beyond
    its ends. `temperature` is a table (depths, in-situ temperatures [degree_Celsius]); None keeps
    the hull at its reference temperature.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        current_program: ArrayLike | None = None,
        density: Density | None = None,
        temperature: tuple[ArrayLike, ArrayLike] | None = None,
    ):
        self.vehicle = vehicle
        program = np.zeros(0) if current_program is None else current_program
        self.program = np.ascontiguousarray(program, dtype=np.float64)
        water = (np.zeros(0), np.zeros(0))
        if temperature is not None:
            water = _checked_table("temperature", *temperature)
        self.parameters: ForceParameters = parameters_of(
            vehicle, *_density_table(vehicle, density), *water
        )
        fields = ("low", "high", "lag", "rate", "one_way")
        law = [[float(getattr(part, name)) for part in vehicle.parts] for name in fields]
        self._law = np.array(law, dtype=np.float64)

    def simulate(
        self,
        initial_state: FossenState,
        schedule: Schedule,
        duration: float,
        *,
        dt: float = DEFAULT_DT,
        sample_period: float = 0.5,
    ) -> FossenTrajectory:
        """Integrate for `duration` [s], sampled every `sample_period` [s] from the start.

        Steps are at most `dt` [s] and never across a command or a sample. Actuators follow
        d(pos)/dt = clip((command - pos) / lag, -rate, rate) exactly, within their travel.

        Raises:
          InputError, MissionError: a duration, step or schedule that cannot be flown.
          SimulationUnstable: the state became infinite or too fast; `partial` is the track before.
        """
        for name, value in (("duration", duration), ("dt", dt), ("sample_period", sample_period)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"{name} must be above 0 s, not {value!r}")
        schedule.check(self.vehicle)
        times, commands = np.asarray(schedule.times), np.asarray(schedule.commands)
        start = float(initial_state.time)
        if times[0] > start:
            raise MissionError(
                f"the schedule begins at {times[0]:g} s, after the start at {start:g} s: "
                "give a command for the start"
            )
        count = int(np.floor(duration / sample_period + 1e-9)) + 1
        samples = start + sample_period * np.arange(count)
        inside = times[(times > start) & (times < samples[-1])]
        breakpoints = np.union1d(samples, inside)
        held = commands[np.searchsorted(times, breakpoints[:-1], side="right") - 1]

        position, attitude, v_rel, rates, given = (
            np.asarray(getattr(initial_state, name), dtype=np.float64)
            for name in ("position_ned", "attitude", "v_rel", "rates", "actuators")
        )
        hull = temperature_at(self.parameters, float(position[2]))
        y0 = np.concatenate((position, euler_to_quaternion(*attitude), v_rel, rates, [hull]))
        low, high = self._law[0], self._law[1]
        if given.size not in (0, low.size):
            raise InputError(
                f"the start has positions of {given.size} actuators, vehicle "
                f"{self.vehicle.name!r} has {low.size}: {', '.join(self.vehicle.part_names)}"
            )
        actuators0 = np.clip(given if given.size else self.vehicle.rest, low, high)
        states, actuators, done = integrate(
            self.parameters, self.program, self._law, y0, actuators0, breakpoints,
            np.ascontiguousarray(held), float(dt),
        )  # fmt: skip
        kept = np.isin(breakpoints, samples) & (np.arange(breakpoints.size) < done)
        trajectory = self._trajectory(breakpoints[kept], states[kept], actuators[kept])
        if done < breakpoints.size:
            raise SimulationUnstable(
                f"the Fossen model of vehicle {self.vehicle.name!r} left what can be "
                f"(20 m/s, one radian a step) before {breakpoints[done]:g} s (dt {dt:g} s): use a "
                "smaller dt or a slower start",
                mission=0,
                time_s=float(breakpoints[done]),
                partial=trajectory,
            )
        return trajectory

    def _trajectory(self, time: Array, states: Array, actuators: Array) -> FossenTrajectory:
        position, quaternion = states[:, POSITION], states[:, QUATERNION]
        v_rel = states[:, NU_R][:, :3]
        flow = [sample(self.program, t, *x, 0.0, 0.0, 0.0)[:3] for t, *x in np.c_[time, position]]
        current = np.array(flow).reshape(-1, 3)
        through_water = np.einsum("tij,tj->ti", quaternion_to_matrix(quaternion), v_rel)
        return FossenTrajectory(
            time=time,
            position_ned=position,
            quaternion=quaternion,
            v_rel=v_rel,
            rates=states[:, NU_R][:, 3:],
            actuators=actuators,
            current_ned=current,
            velocity_ned=through_water + current,
        )

    def steady_motion(
        self,
        shift: float = 0.0,
        rotation: float = 0.0,
        net_mass: float = 0.0,
        *,
        positions: Mapping[str, float] | None = None,
    ) -> SteadyMotion:
        """Find the stable steady motion at fixed part positions, deep in reference density.

        The arguments are those of `twin.vehicle.steady_motion.trim_positions`. Of several stable
        motions, the one with the smallest angle of attack is returned. Raises NoSteadyState with
        the reason if there is none, and InputError outside the travel of a part.
        """
        wanted = trim_positions(self.vehicle, shift, rotation, net_mass, positions)
        turning = self.vehicle.steered_index("heading")
        problem = SteadyProblem(
            self.parameters,
            wanted,
            turning,
            driven(self.vehicle, wanted),
            request=positions_text(self.vehicle, wanted),
            hint=advice(self.vehicle, wanted),
        )
        require_drive(self.vehicle, wanted, problem.net_mass)
        return stable_motion(problem, self.vehicle.law.valid_angle)

    def trim(
        self,
        shift: float = 0.0,
        rotation: float = 0.0,
        net_mass: float = 0.0,
        *,
        positions: Mapping[str, float] | None = None,
    ) -> Trim:
        """Numbers of `steady_motion`, with the same arguments and errors."""
        return self.steady_motion(shift, rotation, net_mass, positions=positions).trim


def _density_table(vehicle: Vehicle, density: Density | None) -> tuple[Array, Array]:
    """Depths [m] and densities [kg/m3] of any accepted `density`."""
    if density is None:
        return np.zeros(1), np.array([float(vehicle.reference_density)])
    if callable(density):
        depths, values = DENSITY_TABLE, np.asarray(density(DENSITY_TABLE), dtype=np.float64)
        values = np.broadcast_to(values, depths.shape)
    else:
        depths, values = _checked_table("density", *density)
    if not np.all(np.isfinite(values) & (values > 0.0)):
        raise InputError("the densities of a density table must be finite and above 0 kg/m3")
    return depths, values


def _checked_table(what: str, depth: ArrayLike, value: ArrayLike) -> tuple[Array, Array]:
    """Check a table over depth; returns depths and values, each of shape (n,)."""
    depths, values = (np.atleast_1d(np.asarray(part, dtype=np.float64)) for part in (depth, value))
    if depths.ndim != 1 or depths.shape != values.shape or depths.size == 0:
        raise InputError(f"a {what} table needs as many values as depths, at least one")
    if not (np.all(np.isfinite(depths)) and np.all(np.diff(depths) > 0.0)):
        raise InputError(f"the depths of a {what} table must be finite and increase, in m")
    if not np.all(np.isfinite(values)):
        raise InputError(f"the values of a {what} table must be finite")
    return depths, values
