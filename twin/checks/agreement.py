"""Agreement: the MuJoCo twin against the Fossen model and against published numbers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from twin.checks.published import (
    MODELS,
    Array,
    PublishedMotion,
    held_flight,
    published_flights,
    published_glides,
)
from twin.errors import SimulationUnstable
from twin.fossen import FossenModel, FossenState, FossenTrajectory
from twin.fossen.model import DEFAULT_DT
from twin.frames import euler_to_quaternion, quaternion_to_matrix
from twin.mission.controller import Schedule
from twin.physics.scenario import Scenario
from twin.physics.settle import trim as settle
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.physics.stiffness import file_timestep
from twin.records.trajectory import Trajectory
from twin.vehicle.presets import vehicle_names
from twin.vehicle.steady_motion import Trim
from twin.vehicle.vehicle import Vehicle, load_vehicle
from twin.water.current.base import Current
from twin.water.current.profile import Profile, Uniform
from twin.water.current.series import GaussMarkov
from twin.water.current.tide import TidalEllipse, Tide

MANOEUVRES = 20
DURATION = 600.0
"""[s] Duration of each manoeuvre."""
SPEED_LIMIT, ATTITUDE_LIMIT, POSITION_LIMIT = 1e-3, 0.1, 0.3
"""Limits of agreement: RMS speed [m/s], RMS attitude [deg], position [% of distance]."""
START_DEPTH = 1000.0
"""[m] Depth of the start, far from the surface."""
USUAL_APART = 10.0
"""[m] Largest usual distance between the ends of two engines' runs of six hours; a doubled step
alone moves a surfacing by up to 5 m (`python -m benchmarks.forecast_speed`)."""
LEG = (60.0, 150.0)
"""[s] Range of times between actuator steps."""
SHEAR = 0.2
"""[m/s] Standard deviation of each component of the sheared current, at depths 100 m apart."""
TIDE = 0.5
"""[m/s] Amplitude of the tide."""
WANDER = 0.1
"""[m/s] Standard deviation of a current with a correlation time of 10 min."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """Random open-loop manoeuvre: actuator steps in a sheared current that varies in time."""

    seed: int
    schedule: Schedule
    current: Current
    start: Start

    def scenario(self, vehicle: Vehicle, **fields: Any) -> Scenario:
        """Scenario of the manoeuvre; `fields` sets other fields of the scenario."""
        return Scenario(
            vehicle=vehicle, mission=self.schedule, start=self.start, current=self.current, **fields
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Difference:
    """Difference of two runs of one manoeuvre: MuJoCo and Fossen model, or two engines."""

    seed: int
    speed_m_s: float
    """RMS difference of the speed through the water [m/s]."""
    attitude_deg: float
    """RMS angle of the rotation between the two attitudes [deg]."""
    position_percent: float
    """Largest position difference as a percentage of the distance travelled [%]."""
    distance_m: float
    """Path length over ground [m]."""

    @property
    def ok(self) -> bool:
        """True if speed, attitude and position are within the limits."""
        return (
            self.speed_m_s <= SPEED_LIMIT
            and self.attitude_deg <= ATTITUDE_LIMIT
            and self.position_percent <= POSITION_LIMIT
        )


def draw_manoeuvre(vehicle: Vehicle, seed: int, duration: float = DURATION) -> Manoeuvre:
    """Sample actuator steps every 60 to 150 s, a mix of dives, climbs and spirals.

    The sampled current is the sum of a sheared, a tidal and a wandering one.
    """
    rng = np.random.default_rng([seed, 2013])
    order = sorted(range(len(vehicle.parts)), key=lambda k: vehicle.parts[k].turn)
    time, times, commands = 0.0, [], []
    heavy = 1.0
    while time < duration:
        command = np.zeros(len(vehicle.parts))
        for k in order:
            command[k] = vehicle.parts[k].manoeuvre(rng, heavy, vehicle)
        times.append(time)
        commands.append(tuple(command.tolist()))
        # commands start on the vehicle's control ticks, like those of its guidance
        time += vehicle.control_period * round(rng.uniform(*LEG) / vehicle.control_period)
        heavy = heavy if rng.random() < 0.5 else -heavy
    depths = np.linspace(START_DEPTH - 400.0, START_DEPTH + 400.0, 9)
    profile = rng.normal(0.0, SHEAR, (2, depths.size))
    steady = Uniform(north=float(rng.normal(0, 0.1)), east=float(rng.normal(0, 0.1)))
    sheared = Profile(depth=tuple(depths), north=tuple(profile[0]), east=tuple(profile[1]))
    direction, phase, wandering = (float(rng.uniform(0.0, 360.0)) for _ in range(3))
    ellipse = TidalEllipse(
        constituent="M2", semi_major=TIDE, direction_deg=direction, phase_deg=phase
    )
    wander = GaussMarkov(
        speed=0.0,
        speed_std=WANDER,
        direction_deg=wandering,
        direction_std_deg=60.0,
        correlation_time=600.0,
        seed=seed,
    )
    current = steady + sheared + Tide(ellipses=(ellipse,)) + wander
    start = Start(
        depth=START_DEPTH,
        heading=rng.uniform(0, 2 * math.pi),
        pitch=-0.4,
        v_rel=(0.35, 0.0, 0.01),
        actuators=commands[0],
    )
    schedule = Schedule(times=times, commands=commands)
    return Manoeuvre(seed=seed, schedule=schedule, current=current, start=start)


def fly_both(
    vehicle: Vehicle,
    manoeuvre: Manoeuvre,
    duration: float = DURATION,
    timestep: float | None = None,
) -> tuple[Trajectory, FossenTrajectory]:
    """Fly one manoeuvre in both models, with the same samples.

    timestep: MuJoCo's [s]; None: the vehicle file's. The Fossen model steps by DEFAULT_DT, or by
    the file's step if that is shorter.
    """
    scenario = manoeuvre.scenario(vehicle, duration=duration, timestep=timestep)
    start = manoeuvre.start
    water = scenario.density
    fossen = FossenModel(
        vehicle,
        current_program=manoeuvre.current.compile(duration),
        density=None if water is None else (water.depth, water.values),
    )
    state = FossenState(
        position_ned=(start.north, start.east, start.depth),
        attitude=(start.roll, start.pitch, start.heading),
        v_rel=start.v_rel,
        rates=start.rates,
        actuators=start.positions(vehicle.part_names, vehicle.rest),
    )
    # a vehicle whose file has a shorter step is too stiff for DEFAULT_DT in this model too
    dt = min(DEFAULT_DT, file_timestep(vehicle))
    return simulate(scenario), fossen.simulate(state, manoeuvre.schedule, duration, dt=dt)


def compare(ours: Trajectory, theirs: Trajectory | FossenTrajectory, seed: int) -> Difference:
    """Compute the three numbers of agreement of two runs with the same sample times."""
    speed = np.linalg.norm(ours.v_rel, axis=1) - np.linalg.norm(theirs.v_rel, axis=1)
    relative = np.einsum("tji,tjk->tik", _to_ned(ours), _to_ned(theirs))
    # the sine of half the angle is accurate for small angles, and the cosine is not
    sine = np.linalg.norm(relative - np.eye(3), axis=(1, 2)) / math.sqrt(8.0)
    attitude = np.rad2deg(2 * np.arcsin(np.clip(sine, 0.0, 1.0)))
    track = _track(theirs)
    position = np.linalg.norm(_track(ours) - track, axis=1)
    steps = np.linalg.norm(np.diff(track, axis=0), axis=1)
    distance = float(steps.sum())
    return Difference(
        seed=seed,
        speed_m_s=float(np.sqrt(np.mean(speed**2))),
        attitude_deg=float(np.sqrt(np.mean(attitude**2))),
        position_percent=float(100.0 * position.max() / distance),
        distance_m=distance,
    )


def _to_ned(flown: Trajectory | FossenTrajectory) -> Array:
    """Rotation matrices body to NED, shape (time, 3, 3)."""
    if isinstance(flown, FossenTrajectory):
        return quaternion_to_matrix(flown.quaternion)
    angles = [np.deg2rad(flown[f"true_{n}"]) for n in ("roll", "pitch", "heading")]
    return quaternion_to_matrix(euler_to_quaternion(*angles))


def _track(flown: Trajectory | FossenTrajectory) -> Array:
    """Positions NED [m], shape (time, 3)."""
    return flown.position_ned if isinstance(flown, FossenTrajectory) else flown.position


def check_manoeuvres(
    vehicle: Vehicle,
    *,
    count: int = MANOEUVRES,
    seed: int = 0,
    duration: float = DURATION,
    timestep: float | None = None,
) -> list[Difference]:
    """Differences of `count` random manoeuvres; see `fly_both` for the other arguments."""
    differences = []
    for index in range(seed, seed + count):
        manoeuvre = draw_manoeuvre(vehicle, index, duration)
        differences.append(compare(*fly_both(vehicle, manoeuvre, duration, timestep), index))
    return differences


@dataclasses.dataclass(frozen=True, kw_only=True)
class EndsApart:
    """Distance between the ends of a scenario's runs in lanes and in MuJoCo."""

    time_s: float
    """Time of the sample that is compared [s]."""
    position_m: float | None
    """Distance between the positions [m]; None if MuJoCo's run ended before."""
    speed_m_s: float | None
    """Size of the difference of the velocities over ground [m/s]; None as for `position_m`."""
    unstable: str = ""
    """Reason why MuJoCo's run ended before."""

    @property
    def text(self) -> str:
        """Sentence about the distance, for the user."""
        if self.position_m is None or self.speed_m_s is None:
            return f"MuJoCo could not fly it: {self.unstable}"
        hours = self.time_s / 3600.0
        said = (
            f"MuJoCo ends {self.position_m:.2g} m and {1e3 * self.speed_m_s:.2g} mm/s from it "
            f"after {hours:.2f} h"
        )
        usual = USUAL_APART * max(1.0, hours / 6.0)
        if self.position_m > usual:
            return f"{said}: more than the {usual:.0f} m that are usual; --engine mujoco flies all"
        if self.speed_m_s > SPEED_LIMIT:
            return f"{said}: usual, its speed differs most while it turns"
        return f"{said}: usual"


def flown_in_mujoco(scenario: Scenario) -> Trajectory | SimulationUnstable:
    """Fly a scenario of any engine in MuJoCo, at the step of its vehicle's file."""
    try:
        return simulate(dataclasses.replace(scenario, engine="mujoco", timestep=None))
    except SimulationUnstable as error:
        return error


def state_at(run: Trajectory, index: int) -> Array:
    """North, east, depth [m] and the velocity over ground, NED [m/s], at a sample, (6,)."""
    velocity = [run[f"true_velocity_{axis}"][index] for axis in ("north", "east", "down")]
    return np.array([*run.position[index], *velocity])


def ends_apart(time: float, state: Array, theirs: Trajectory | SimulationUnstable) -> EndsApart:
    """Compare a run with MuJoCo's at a time [s] within both.

    Args:
      state: state of the run at that time, see `state_at`.
    """
    if isinstance(theirs, SimulationUnstable):
        return EndsApart(time_s=time, position_m=None, speed_m_s=None, unstable=str(theirs))
    off = state - state_at(theirs, int(np.abs(theirs.time - time).argmin()))
    return EndsApart(
        time_s=time,
        position_m=float(np.linalg.norm(off[:3])),
        speed_m_s=float(np.linalg.norm(off[3:])),
    )


def check_published(vehicle: Vehicle | None = None) -> list[tuple[PublishedMotion, str, Trim]]:
    """Compute every published motion with both models: (motion, model name, trim).

    vehicle: compute only its motions, and none if it differs from the shipped vehicle of its name.
    """
    name = None if vehicle is None else vehicle.name
    if vehicle is not None and not _is_shipped(vehicle):
        return []
    results: list[tuple[PublishedMotion, str, Trim]] = []
    for glide in published_glides(name):
        loaded = load_vehicle(glide.vehicle)
        models: dict[str, Callable[[float, float, float], Trim]] = {
            "mujoco": lambda *request, loaded=loaded: settle(loaded, *request),
            "fossen": FossenModel(loaded).trim,
        }
        for model, solve in models.items():
            trim = solve(glide.shift, glide.rotation_rad, glide.net_mass)
            results.append((glide, model, trim))
    for flight in published_flights(name):
        loaded = load_vehicle(flight.vehicle)
        for model in MODELS:
            request = flight.request(loaded.steering["heading"])
            results.append((flight, model, held_flight(loaded, model=model, **request).trim))
    return results


def _is_shipped(vehicle: Vehicle) -> bool:
    """Tell whether a vehicle is a shipped one, not just one of the same name."""
    return vehicle.name in vehicle_names() and load_vehicle(vehicle.name).xml == vehicle.xml
