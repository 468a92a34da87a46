"""Fly: simulate and measure missions from their parameters; replays run the same code.

A simulation whose signals leave their limits, or that touches the ground, counts as failed.
`GivenCurrent` is one current for all missions, from `--current`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from factory.sampling.conditions import (
    ballast_of,
    believed_vehicle,
    bottom_depth,
    build_current,
    build_density,
    build_floor,
    encoder_zeros,
    origin,
    spread_vehicle,
)
from factory.sampling.draw import Parameters, kind_of
from twin.errors import (
    CurrentError,
    FloorError,
    MissionError,
    NoSteadyState,
    SimulationUnstable,
    TwinError,
    VehicleError,
)
from twin.mission import Mission, Segment
from twin.physics.lanes import Aground, Lane, flown_abreast
from twin.physics.model_block import Tables
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.physics.true_signals import ENGINES, SAMPLE_PERIOD
from twin.records.schema import VARIABLES
from twin.records.schema.limits import simulated_limits
from twin.vehicle.vehicle import Vehicle
from twin.water.current import Origin, current_from_dict, parse_current
from twin.water.current.base import Current
from twin.water.current.sampler import Floats
from twin.water.floor.lookup import floor_depths

if TYPE_CHECKING:
    from twin.records.trajectory import Trajectory
    from twin.sensors import SensorSuite

Array = NDArray[np.float64]


class Impossible(TwinError):
    """Simulation that stayed finite and left the limits of a signal at `time_s` [s]."""

    def __init__(self, message: str, *, time_s: float):
        super().__init__(message)
        self.time_s = time_s


REPLACED = (
    *(MissionError, VehicleError, CurrentError, FloorError, NoSteadyState),
    *(SimulationUnstable, Impossible),
)
"""Errors of an attempt that another replaces: impossible mission or vehicle, unstable simulation"""


def check_possible(truth: Mapping[str, Array], time: Array) -> None:
    """Raise Impossible if a simulated signal leaves its limits; NaN is not checked.

    Args:
      truth: signals by name, each of shape (time,).
      time: [s], shape (time,).
    """
    earliest, culprit = len(time), ""
    for name, values in truth.items():
        low, high = simulated_limits(name)
        outside = (values < low) | (values > high)
        if outside[:earliest].any():
            earliest, culprit = int(np.argmax(outside)), name
    if culprit:
        low, high = simulated_limits(culprit)
        raise Impossible(
            f"{culprit} became {truth[culprit][earliest]:.3g} {VARIABLES[culprit].units} at "
            f"{time[earliest]:.1f} s, possible are {low:g} to {high:g}",
            time_s=float(time[earliest]),
        )


def _grounded(when: float) -> Impossible:
    return Impossible(f"ran aground at {when:.1f} s", time_s=when)


@dataclass(frozen=True, kw_only=True)
class FlownSignals:
    """Signals of one flown mission."""

    trajectory: Trajectory
    measured: Mapping[str, Array]
    drawn: Mapping[str, float]
    """Sampled constants of this mission's sensors"""

    @property
    def signals(self) -> dict[str, Array]:
        """True, measured and commanded signals, each of shape (time,)."""
        return {**self.trajectory.signals, **self.measured}


@dataclass(frozen=True, kw_only=True)
class Draw:
    """Parameters and sensor seed of one mission."""

    parameters: Parameters
    sensor_seed: np.random.SeedSequence
    constants: Mapping[str, float] | None = None
    """Constants of the sensors; None samples them from the seed"""


def build_mission(parameters: Parameters, vehicle: Vehicle) -> Mission:
    """Build the mission that guidance flies."""
    start_heading = heading = parameters.number("mission.start_heading_deg")
    segments: list[Segment] = []
    for drawn in parameters.segments:
        segment, heading = kind_of(drawn).segment(drawn, heading, vehicle)
        segments.append(segment)
    return Mission(
        segments=tuple(segments),
        duration_s=parameters.duration_s,
        start_depth_m=parameters.number("mission.start_depth_m"),
        start_heading_deg=start_heading,
        at_end="hold",
    )


def build_scenario(
    parameters: Parameters,
    nominal: Vehicle,
    current: Current | None = None,
    engine: str = ENGINES[0],
) -> Scenario:
    """Build the scenario of a mission; `current` replaces the sampled current."""
    believed = believed_vehicle(nominal, parameters)
    return Scenario(
        vehicle=spread_vehicle(nominal, parameters),
        believed=believed,
        ballast=ballast_of(nominal, parameters),
        encoder_zeros=encoder_zeros(nominal, parameters),
        mission=build_mission(parameters, believed),
        duration=parameters.duration_s,
        current=build_current(parameters) if current is None else current,
        density=build_density(parameters),
        floor=build_floor(parameters, nominal),
        origin=origin(parameters),
        engine=engine,
        sample_period=SAMPLE_PERIOD,
    )


def fly(
    parameters: Parameters,
    nominal: Vehicle,
    suite: SensorSuite,
    sensor_seed: np.random.SeedSequence,
    *,
    current: Current | None = None,
    drawn: Mapping[str, float] | None = None,
    engine: str = ENGINES[0],
) -> FlownSignals:
    """Fly one mission and measure it.

    Args:
      current: current instead of the sampled one.
      drawn: constants of the sensors; None samples them from the seed.
      engine: physics engine, one of ENGINES.

    Raises:
      MissionError: the vehicle cannot fly the mission.
      SimulationUnstable: the simulation lost finite values.
      Impossible: a signal left its limits, or the vehicle ran aground.
    """
    draw = Draw(parameters=parameters, sensor_seed=sensor_seed, constants=drawn)
    ((_, found),) = fly_abreast([draw], nominal, suite, current=current, engine=engine)
    if isinstance(found, TwinError):
        raise found
    return found


def fly_abreast(
    draws: Sequence[Draw],
    nominal: Vehicle,
    suite: SensorSuite,
    *,
    current: Current | None = None,
    engine: str = ENGINES[0],
) -> Iterator[tuple[int, FlownSignals | TwinError]]:
    """Fly and measure missions; yields the index of each with its signals or an error of REPLACED.

    Missions come in any order, and each is measured when it is yielded. The batched engine flies
    all together; a mission does not depend on the others in the batch.

    Args:
      current: current instead of the sampled ones.
    """
    lanes: dict[int, Lane] = {}
    for index, draw in enumerate(draws):
        try:
            scenario = build_scenario(draw.parameters, nominal, current, engine)
            if engine == "lanes":
                lanes[index] = Lane(scenario)
                continue
            one = Simulation(scenario)
            flown = one.run()
            yield index, _measured(draw, scenario, flown, one.tables, one.duration, suite)
        except REPLACED as error:
            yield index, error
    places = list(lanes)
    for place, found in flown_abreast(list(lanes.values())):
        index, lane = places[place], lanes[places[place]]
        try:
            if isinstance(found, Aground):
                raise _grounded(found.time_s)
            if isinstance(found, SimulationUnstable):
                raise found
            draw, scenario = draws[index], lane.scenario
            yield index, _measured(draw, scenario, found, lane.tables, lane.duration, suite)
        except REPLACED as error:
            yield index, error


def _measured(
    draw: Draw,
    scenario: Scenario,
    trajectory: Trajectory,
    tables: Tables,
    duration: float,
    suite: SensorSuite,
) -> FlownSignals:
    """Check a flight and measure it with the sensors; raises Impossible."""
    check_possible(trajectory.signals, trajectory.time)
    contact = trajectory.signals.get("true_contact")
    if contact is not None and contact.any():
        raise _grounded(float(trajectory.time[np.argmax(contact)]))
    parameters, seed = draw.parameters, draw.sensor_seed
    drawn = suite.draw(seed) if draw.constants is None else draw.constants
    water, floor = scenario.current, tables.floor
    bottom: ArrayLike | None = bottom_depth(parameters)
    if floor.size:
        bottom = floor_depths(floor, trajectory["true_north"], trajectory["true_east"])
    measured = suite.measure(
        trajectory.signals,
        dt=SAMPLE_PERIOD,
        rng_seed=seed,
        drawn=drawn,
        bottom_depth=bottom,
        floor=floor if floor.size else None,
        latitude=parameters.number("water.latitude"),
        longitude=parameters.number("water.longitude"),
        density=scenario.density,
        current=None if water is None else water.compile(duration, scenario.origin),
    )
    return FlownSignals(trajectory=trajectory, measured=measured, drawn=drawn)


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenCurrent(Current):
    """Current that is compiled once for all missions; gridded files are read once."""

    program: Floats
    """Compiled current for the longest mission"""
    description: Mapping[str, Any]
    """Description for `current_from_dict`, with all settings written out"""

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Raise NotImplementedError, since `compile` returns the program."""
        raise NotImplementedError("a given current is compiled already")

    def compile(self, duration_s: float, origin: Origin | None = None) -> Floats:
        """Return the program, which is the same for every mission."""
        return self.program

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """Return the start place and time of the described current."""
        return current_from_dict(self.description).begins(duration_s, origin)

    def describe(self) -> dict[str, Any]:
        """Return the description."""
        return dict(self.description)


def given_current(given: str | Mapping[str, Any], longest_s: float) -> GivenCurrent:
    """Compile the current of all missions, which last at most `longest_s` [s].

    Args:
      given: text of `--current`, or the description in a store.

    Raises:
      CurrentError: the current cannot be used, or one of its files has changed.
    """
    if isinstance(given, Mapping):
        current = current_from_dict(given)
    else:
        current = parse_current(given).pinned(longest_s)
    return GivenCurrent(program=current.compile(longest_s), description=current.describe())
