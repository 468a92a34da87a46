"""Fly: one mission from its parameters to its signals. Replays run the same code.

A simulation is a mission to keep when it stays possible and off the ground.
Given current: one current for all missions, as `--current` describes it.
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
    """A simulation that stayed finite and left what is possible at `time_s`."""

    def __init__(self, message: str, *, time_s: float):
        super().__init__(message)
        self.time_s = time_s


REPLACED = (
    *(MissionError, VehicleError, CurrentError, FloorError, NoSteadyState),
    *(SimulationUnstable, Impossible),
)
"""What a draw can do wrong: the vehicle cannot fly it, cannot exist, or runs away."""


def check_possible(truth: Mapping[str, Array], time: Array) -> None:
    """Raise Impossible when a simulated signal leaves its limits; NaN is left to others.

    Args:
      truth: signals of shape (time,), by name.
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
    """One mission as it was flown."""

    trajectory: Trajectory
    measured: Mapping[str, Array]
    drawn: Mapping[str, float]
    """The sensors' constants of this mission."""

    @property
    def signals(self) -> dict[str, Array]:
        """Truth, measured and commanded, each of shape (time,)."""
        return {**self.trajectory.signals, **self.measured}


@dataclass(frozen=True, kw_only=True)
class Draw:
    """What one mission is flown and measured by."""

    parameters: Parameters
    sensor_seed: np.random.SeedSequence
    constants: Mapping[str, float] | None = None
    """of its sensors; None: those that the seed gives"""


def build_mission(parameters: Parameters, vehicle: Vehicle) -> Mission:
    """The mission that the guidance is given."""
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
    """Everything that the physics needs; `current` replaces the drawn one."""
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
      current: instead of the drawn one.
      drawn: the sensors' constants, by default those that the seed gives.
      engine: what flies it, one of ENGINES.

    Raises:
      MissionError: the vehicle cannot fly it.
      SimulationUnstable: the simulation left the finite numbers.
      Impossible: it left the physically possible ones, or ran aground.
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
    """Fly missions and measure them: the index of each, with its signals or with one of REPLACED.

    They come in any order, and each one's signals are made when it is asked for. In lanes the
    missions fly together; a mission is the same whatever flies beside it.

    Args:
      current: instead of the drawn ones.
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
    """What the sensors make of a flight; raises Impossible."""
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
    """A current compiled once, however many missions meet it; gridded files are read once."""

    program: Floats
    """Compiled for the longest mission"""
    description: Mapping[str, Any]
    """What `current_from_dict` rebuilds it from, everything pinned"""

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Not needed: `compile` has the program."""
        raise NotImplementedError("a given current is compiled already")

    def compile(self, duration_s: float, origin: Origin | None = None) -> Floats:
        """The program, the same for every mission."""
        return self.program

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """As the current itself."""
        return current_from_dict(self.description).begins(duration_s, origin)

    def describe(self) -> dict[str, Any]:
        """The description."""
        return dict(self.description)


def given_current(given: str | Mapping[str, Any], longest_s: float) -> GivenCurrent:
    """The current of all missions, which last at most `longest_s` [s].

    Args:
      given: as `--current` takes it, or the description that a store holds.

    Raises:
      CurrentError: it cannot be used, or a file of it has changed.
    """
    if isinstance(given, Mapping):
        current = current_from_dict(given)
    else:
        current = parse_current(given).pinned(longest_s)
    return GivenCurrent(program=current.compile(longest_s), description=current.describe())
