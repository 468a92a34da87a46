"""Facade of the simulation: plain values to a `Scenario` and its `Trajectory`, in one call."""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.errors import InputError, SimulationUnstable
from twin.faults.base import Fault, parse_faults, read_by
from twin.mission import Mission, check_depth
from twin.mission.controller import Controller, Schedule
from twin.mission.shipped_missions import load_mission_for
from twin.navigation.estimators.base import VelocityEstimator
from twin.navigation.settings import Navigation
from twin.physics.condition import BODY, INSTRUMENTS, differs, electric_signals, healthy
from twin.physics.model_block import floor_table
from twin.physics.scenario import SAMPLE_PERIOD, Scenario, Start
from twin.physics.simulation import simulate as fly
from twin.physics.start import parse_place, weighed
from twin.records.attributes import SENSOR_SUITE
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle, load_vehicle
from twin.water.current.axes import Origin
from twin.water.current.base import Current, parse_current
from twin.water.density import GRID, DensityProfile, parse_density
from twin.water.floor import Floor, parse_floor
from twin.water.floor.lookup import floor_depths

if TYPE_CHECKING:
    from twin.sensors import SensorSuite

_BESIDE_A_SCENARIO = ("scenario", "controller", "sensors", "seed", "bottom_depth")
_FAULTS = 0xFA17
"""Spawn key of the random stream for faulty sensors and batteries"""


def simulate(
    scenario: Scenario | None = None,
    *,
    vehicle: str | Path | Vehicle = "glider",
    mission: str | Path | Mission | Schedule | None = None,
    current: str | Current | None = None,
    density: str | Path | DensityProfile | None = None,
    ballast_at: float | None = None,
    mass: float | None = None,
    compressibility: float | None = None,
    floor: str | Floor | None = None,
    faults: str | Sequence[str | Fault] = (),
    duration: float | None = None,
    start: Start | Mapping[str, Any] | None = None,
    origin: Origin | None = None,
    engine: str = "mujoco",
    hydrodynamics: str = "coefficients",
    timestep: float | None = None,
    integrator: str | None = None,
    sample_period: float = SAMPLE_PERIOD,
    controller: Controller | None = None,
    sensors: str | SensorSuite | None = None,
    seed: int = 0,
    bottom_depth: float | None = None,
    navigate: str | VelocityEstimator | None = None,
) -> Trajectory:
    """Fly one mission and return its trajectory.

    Args:
      scenario: the whole scenario; only `controller` and the sensors' arguments may accompany it.
      vehicle: shipped name, path of an MJCF file, or a Vehicle.
      mission: shipped name, path of a TOML file, a Mission or a Schedule. Without a mission and
        a controller, the shipped mission that suits the vehicle is flown.
      current: text such as "uniform:0.1,-0.05" (north, east [m/s]), or an object; + adds
        currents.
      density: "usual", "constant", "thermocline", "grid" (temperature and salinity of the current's
        file at the start), a CSV file, or a DensityProfile; None is "usual".
      ballast_at: [m] depth at which the vehicle is neutral in this water; None: neutral in water of
        the reference density at the surface.
      mass: [kg] mass of the whole vehicle, whose hull keeps its volume; None takes the file's.
      compressibility: [1/Pa] compressibility of the hull; None takes the file's.
      floor: sea floor as text, "depth:200" [m] or a bathymetry file such as GEBCO's, or a Floor;
        None is water without a bottom.
      faults: faults of the vehicle, as texts such as "fouling:per_day=0.02,from=3d", or objects.
      duration: [s] simulated time; None takes the mission's own.
      start: place, time and state at the beginning: a Start, or some of its fields by name, such as
        {"latitude": 49.0, "longitude": -16.0, "time": "2003-08-01"}; None takes the mission's.
      origin: latitude, longitude and time of the frame's origin; None takes the start's.
      engine: "mujoco", or "lanes", the Fossen model (docs/howto/lanes.md).
      hydrodynamics: "coefficients" or "ellipsoid".
      timestep: [s] step of the physics; None takes the vehicle file's.
      integrator: MuJoCo's integrator; None takes the vehicle file's.
      sample_period: [s] between samples.
      controller: Python code that gives the commands each control period instead of a mission.
      sensors: suite by name ("ideal", "field", ...) or a SensorSuite; adds measured_* signals.
      seed: seed of the sensors' random numbers.
      bottom_depth: [m] depth of the bottom for the sensors, without `floor`; None: out of range.
      navigate: state that guidance sees: "truth" (None), or an estimate made on board from the
        sensors (default: suite "field"): "estimate", the name of a velocity estimator such as
        "ekf" or "network:runs/mine", or an estimator object.

    Returns:
      The trajectory: a mapping of signals in NED and FRD, angles in degrees.

    Raises:
      InputError and its subclasses: a name or value that cannot be used; nothing was flown.
      SimulationUnstable: with the trajectory up to that time as `partial`.
    """
    given = dict(locals())
    if controller is not None and not callable(controller):
        raise InputError(f"controller is {controller!r}: give a function of an Observation")
    own = seed != 0 or bottom_depth is not None
    if scenario is None:
        if mission is not None and controller is not None:
            raise InputError("give a mission or a controller, not both: each gives the commands")
        named = {name: given[name] for name in given.keys() & _OF_A_SCENARIO}
        scenario = scenario_of(**named, commanded=controller is not None)
    else:
        _refuse_beside(scenario, given)
        if isinstance(scenario.navigate, Navigation) and (own or sensors is not None):
            raise InputError(
                "the scenario is navigated and has its own sensors: leave sensors, seed and "
                "bottom_depth out"
            )
    suite = _suite(sensors, seed)
    if isinstance(scenario.navigate, Navigation):
        suite = scenario.navigate.suite
    if isinstance(scenario.mission, Mission):
        scenario.mission.check(scenario.vehicle)
        check_depth(scenario.mission.deepest, scenario.vehicle)
    if suite is None:
        _refuse_unseen(scenario)
        if own:
            raise InputError("seed and bottom_depth are for the sensors: give sensors too")
    if bottom_depth is not None and scenario.floor is not None:
        raise InputError(
            "give a floor or a bottom_depth, not both: the sensors see the scenario's floor"
        )
    try:
        trajectory = _named(fly(scenario, controller), scenario)
    except SimulationUnstable as error:
        if error.partial is not None:
            error.partial = _named(error.partial, scenario)
        raise
    if suite is None:
        return trajectory
    return with_sensors(trajectory, scenario, suite, seed=seed, bottom_depth=bottom_depth)


def scenario_of(
    *,
    vehicle: str | Path | Vehicle = "glider",
    mission: str | Path | Mission | Schedule | None = None,
    current: str | Current | None = None,
    density: str | Path | DensityProfile | None = None,
    ballast_at: float | None = None,
    mass: float | None = None,
    compressibility: float | None = None,
    floor: str | Floor | None = None,
    faults: str | Sequence[str | Fault] = (),
    duration: float | None = None,
    start: Start | Mapping[str, Any] | str | None = None,
    origin: Origin | None = None,
    engine: str = "mujoco",
    hydrodynamics: str = "coefficients",
    timestep: float | None = None,
    integrator: str | None = None,
    sample_period: float = SAMPLE_PERIOD,
    sensors: str | SensorSuite | None = None,
    seed: int = 0,
    bottom_depth: float | None = None,
    navigate: str | VelocityEstimator | None = None,
    commanded: bool = False,
) -> Scenario:
    """Build a scenario from plain values; nothing is flown.

    Arguments without a line here are those of `simulate`.

    Args:
      start: as in `simulate`, or a text "LATITUDE,LONGITUDE" or "LATITUDE,LONGITUDE,TIME".
      sensors: sensor suite by which guidance navigates.
      seed: seed of the sensors' random numbers.
      bottom_depth: [m] depth of the bottom for the sensors, without `floor`.
      commanded: a controller will give the commands, so that no mission is taken by default.

    Raises:
      InputError and its subclasses: a name or value that cannot be used.
    """
    suite = _suite(sensors, seed)
    navigation = Navigation.of(navigate)
    if navigation is not None:
        navigation = dataclasses.replace(
            navigation,
            sensors=navigation.suite if suite is None else suite,
            seed=seed,
            bottom_depth=bottom_depth,
        )
    flown = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(str(vehicle))
    given = {"ballast_at": ballast_at, "mass": mass, "compressibility": compressibility}
    flown, ballast = weighed(flown, **given)
    floor = parse_floor(floor) if isinstance(floor, str) else floor
    if isinstance(mission, str | Path) or (mission is None and not commanded):
        mission = load_mission_for(flown, mission, above_floor=floor is not None)
    words = [faults] if isinstance(faults, str) else faults
    parsed = [parse_faults(word) if isinstance(word, str) else (word,) for word in words]
    scenario = Scenario(
        vehicle=flown,
        ballast=ballast,
        mission=mission,
        navigate=navigation,
        duration=duration,
        start=parse_place(start) if isinstance(start, str) else start,
        current=parse_current(current) if isinstance(current, str) else current,
        density=None if isinstance(density, str | Path) else density,
        floor=floor,
        faults=tuple(itertools.chain(*parsed)),
        origin=origin,
        engine=engine,
        hydrodynamics=hydrodynamics,
        timestep=timestep,
        integrator=integrator,
        sample_period=sample_period,
    )
    return in_water(scenario, str(density)) if isinstance(density, str | Path) else scenario


_OF_A_SCENARIO = inspect.signature(scenario_of).parameters.keys()
"""Arguments that `simulate` passes to `scenario_of`"""


def _named(trajectory: Trajectory, scenario: Scenario) -> Trajectory:
    """Add the names of vehicle and mission, and the whole scenario, to the provenance."""
    plan = scenario.mission
    said = {
        "vehicle": scenario.vehicle.name,
        "mission": plan.name if isinstance(plan, Mission) else "schedule" if plan else "controller",
        "scenario": json.dumps(scenario.describe()),
    }
    return dataclasses.replace(trajectory, provenance={**trajectory.provenance, **said})


def in_water(scenario: Scenario, density: str) -> Scenario:
    """Put a scenario into the water column of a name or file, at the place where it begins.

    Raises:
      InputError: as `parse_density`; or "grid" without a current's file that has temperature and
        salinity.
    """
    place = scenario.place
    at = {"latitude": place.latitude_deg, "longitude": place.longitude_deg}
    if density != GRID:
        return dataclasses.replace(scenario, density=parse_density(density, **at))
    from twin.water.current.hydrography import column

    found = column(scenario.current, place)
    if found is None:
        raise InputError(
            "density 'grid' is that of the current's file: give --current grid:FILE of a file that "
            "has sea water temperature and salinity (thetao and so) too"
        )
    depth, temperature, salinity = found
    profile = DensityProfile.from_temperature_salinity(depth, temperature, salinity, **at)
    return dataclasses.replace(scenario, density=profile)


def with_sensors(
    trajectory: Trajectory,
    scenario: Scenario,
    suite: SensorSuite,
    *,
    seed: int = 0,
    bottom_depth: float | None = None,
) -> Trajectory:
    """Add the sensors' measurements to a trajectory, and their settings to its provenance.

    A navigated scenario uses its own sensors; signals measured during the flight stay as they are.
    """
    under_way = {}
    if scenario.navigate is not None:
        assert isinstance(scenario.navigate, Navigation)
        suite, seed = scenario.navigate.suite, scenario.navigate.seed
        bottom_depth = scenario.navigate.bottom_depth
        under_way = {n: a for n, a in trajectory.signals.items() if n.startswith("measured_")}
    measured, drawn = _measure(suite, scenario, trajectory, seed, bottom_depth, under_way)
    if scenario.faults:
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_FAULTS,)))
        measured |= electric_signals(scenario, trajectory, rng)
        given = {**trajectory.signals, **measured}
        wrong = read_by(scenario.faults, given, trajectory.time, rng, period=scenario.sample_period)
        # signals measured during the flight contain the faults already
        wrong = {name: values for name, values in wrong.items() if name not in under_way}
        measured |= wrong
        late = suite.readers(wrong, trajectory.signals) - {*wrong, *under_way}
        if late:
            known = {name: values for name, values in measured.items() if name not in late}
            measured |= _measure(suite, scenario, trajectory, seed, bottom_depth, known)[0]
    said = json.dumps({"settings": suite.settings(), "drawn": drawn, "seed": seed})
    return dataclasses.replace(
        trajectory,
        signals={**trajectory.signals, **measured},
        provenance={**trajectory.provenance, SENSOR_SUITE: said},
    )


def _refuse_unseen(scenario: Scenario) -> None:
    """Raise InputError for a fault that has no effect on a flight without sensors."""
    for fault in scenario.faults:
        plan = scenario.mission
        above_floor = isinstance(plan, Mission) and plan.needs_floor
        seen = [n for n in INSTRUMENTS if n != "echoes_lost" or above_floor]
        if not differs(fault, healthy(scenario), (*BODY, *seen)):
            raise InputError(
                f"fault {fault.kind} changes what the vehicle measures and takes, not how it "
                "flies: give sensors too, such as field (--sensors field)"
            )


def _refuse_beside(scenario: Scenario, given: dict[str, Any]) -> None:
    """Raise InputError for arguments that a given scenario would override."""
    if not isinstance(scenario, Scenario):
        raise InputError(f"scenario is {scenario!r}: give a Scenario, or keyword arguments")
    for name, parameter in inspect.signature(simulate).parameters.items():
        if name not in _BESIDE_A_SCENARIO and given[name] is not parameter.default:
            raise InputError(
                f"{name} is part of the scenario: use dataclasses.replace(scenario, ...)"
            )


def _suite(sensors: str | SensorSuite | None, seed: int) -> SensorSuite | None:
    """Return the sensor suite of a name or object; raise InputError for a negative seed."""
    if isinstance(seed, int) and seed < 0:
        raise InputError(f"seed {seed} must be at least 0")
    if sensors is None:
        return None
    from twin.sensors import SensorSuite

    if isinstance(sensors, str):
        return SensorSuite.preset(sensors)
    if not isinstance(sensors, SensorSuite):
        raise InputError(f"sensors is {sensors!r}: give a SensorSuite or the name of one")
    return sensors


def _measure(
    suite: SensorSuite,
    scenario: Scenario,
    trajectory: Trajectory,
    seed: int,
    bottom_depth: float | None,
    known: Mapping[str, Any],
) -> tuple[dict[str, Any], dict[str, float]]:
    """Measured signals, computed if they are not `known` yet, and the sampled constants."""
    tree = np.random.SeedSequence(seed)
    drawn = suite.draw(tree)
    program = floor = None
    if scenario.current is not None:
        program = scenario.current.compile(float(trajectory.time[-1]), scenario.place)
    bottom: Any = bottom_depth
    if scenario.floor is not None:
        floor = floor_table(scenario, scenario.run_time())
        # the Doppler log's model needs a positive depth; on a beach the depth is 0 or less
        depths = floor_depths(floor, trajectory["true_north"], trajectory["true_east"])
        bottom = np.maximum(depths, 1e-3)
    measured = suite.measure(
        trajectory.signals,
        dt=scenario.sample_period,
        rng_seed=tree,
        drawn=drawn,
        bottom_depth=bottom,
        floor=floor,
        latitude=scenario.place.latitude_deg,
        longitude=scenario.place.longitude_deg,
        density=scenario.density,
        current=program,
        measured=known,
    )
    return measured, drawn
