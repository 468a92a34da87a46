"""Comparison: the twin of a vehicle file beside the logs of the real vehicle, phase by phase."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.checks.agreement import EndsApart, ends_apart, state_at
from twin.checks.calibrated import Calibrated, Uncalibrated
from twin.checks.heading_leg import LEAST_RANGE, PHASES, Phase, Turning, turning_of
from twin.checks.log_figures import phase_figures, turn_per_actuator
from twin.checks.log_flight import fly_dives, legs_flown
from twin.checks.log_result import LogCheck, PhaseComparison
from twin.checks.log_samples import (
    Present,
    angle_of_attack,
    check_logged,
    check_signals,
    flown_samples,
    logged_samples,
    notes_of,
)
from twin.checks.log_turns import FlownTurn, fly_turns
from twin.checks.replayed_dive import ReplayedDive, read_dive
from twin.errors import SimulationUnstable, StoreError, VehicleError
from twin.lazy import resolve
from twin.records.logged import LogStore, log_rows
from twin.records.trajectory import Trajectory
from twin.vehicle.laws import FlowFrame
from twin.vehicle.vehicle import Vehicle, load_vehicle

Array = NDArray[np.float64]


def check_logs(
    store: str | Path,
    vehicle: str | Path | Vehicle | Calibrated,
    *,
    missions: Sequence[int] | None = None,
    engine: str = "mujoco",
) -> LogCheck:
    """Fly the twin of a vehicle on the targets of logged dives, and compare.

    Args:
      store: path of a store that `factory import` wrote.
      vehicle: shipped name or path of an MJCF file, with the errors of the sensors that it holds;
        a vehicle, whose sensors are taken as exact; or `twin.identify.load_calibration(...)`.
      missions: rows of the store, all by default.
      engine: what flies the twin, as of `Scenario`; of lanes the first dive is flown in MuJoCo too.

    Raises:
      StoreError: no store of logs, no such row, no pitch or pump, or no whole dive in any row.
      VehicleError: no such vehicle, or one without a pump or without a part that pitches it.
      InputError, MissionError: the vehicle cannot do what the log's did.
      SimulationUnstable: the twin went unstable in every dive.
    """
    hull = _hull(vehicle)
    flown = _flown_vehicle(hull)
    _check_vehicle(flown)
    check_logged(store)
    with LogStore(store) as logs:
        turning = turning_of(hull.vehicle, Present(logs))
        rows = list(range(len(logs))) if missions is None else list(missions)
        for row in rows:
            logs.check_mission(row)
        said = log_rows(logs)
        powered = [row for row in rows if said[row].powered]
        rows = [row for row in rows if row not in powered]
        check_signals(logs, rows)
        found = [read_dive(logs, row, hull, turning) for row in rows]
        dives = [dive for dive in found if dive is not None]
        if not dives:
            raise StoreError(
                f"store {store} has no whole dive: no mission descends or climbs by "
                f"{LEAST_RANGE:g} m with pitch and pumped volume"
                + f" and without its thruster ({len(powered)} ran it)"
                * bool(powered)
            )
        notes = notes_of(logs, dives, turning, hull.vehicle)
        if powered:
            listed = ", ".join(map(str, powered))
            notes.append(f"left out: {len(powered)} dives ran their thruster ({listed})")
    flights = fly_dives(flown, dives, engine)
    if all(isinstance(flight, SimulationUnstable) for flight in flights):
        raise flights[0]  # type: ignore[misc]
    phases, more = _phases(flown, dives, flights, turning, engine)
    return LogCheck(
        vehicle=flown,
        store=Path(store),
        dives=tuple(dives),
        flights=tuple(flights),
        phases=phases,
        turning=turning,
        engine=engine,
        beside_mujoco=_beside_mujoco(flown, dives, flights) if engine == "lanes" else None,
        notes=(*notes, *more),
    )


def _hull(vehicle: str | Path | Vehicle | Calibrated) -> Calibrated:
    """The vehicle with what its file says of its sensors, where it is of a kind that can."""
    if not isinstance(vehicle, str | Path):
        return Uncalibrated(vehicle=vehicle) if isinstance(vehicle, Vehicle) else vehicle
    loaded = load_vehicle(vehicle)
    _check_vehicle(loaded)
    if not isinstance(loaded.law, FlowFrame):
        return Uncalibrated(vehicle=loaded)
    # looked up when it is needed: identification may check what it found by these very logs
    calibrated: Calibrated = resolve("twin.identify.calibration:load_calibration")(vehicle)
    return calibrated


def _flown_vehicle(hull: Calibrated) -> Vehicle:
    """The vehicle with the expansion that was identified, where its own fields have none."""
    vehicle = hull.vehicle
    if vehicle.hull_thermal_expansion or not hull.thermal_expansion:
        return vehicle
    return vehicle.replace(
        hull_thermal_expansion=hull.thermal_expansion, hull_thermal_lag=hull.thermal_lag
    )


def _check_vehicle(vehicle: Vehicle) -> None:
    """Refuse vehicles that a glider's log says nothing about."""
    for control, what in (("buoyancy", "pump"), ("pitch", "part that pitches it")):
        if vehicle.steered(control) is None:
            raise VehicleError(
                f"vehicle {vehicle.name!r} has no {what} (its parts: "
                f"{', '.join(vehicle.part_names) or 'none'}): logs are compared with the flight of "
                "a glider; give a glider's file"
            )


def _phases(
    vehicle: Vehicle,
    dives: Sequence[ReplayedDive],
    flights: Sequence[Trajectory | SimulationUnstable],
    turning: Turning | None,
    engine: str,
) -> tuple[dict[Phase, PhaseComparison], list[str]]:
    """Log and twin in each phase that the log has, and what must be said about it."""
    pump = vehicle.steering["buoyancy"]
    flown = [
        (dive, flight)
        for dive, flight in zip(dives, flights, strict=True)
        if isinstance(flight, Trajectory)
    ]
    phases: dict[Phase, PhaseComparison] = {}
    turned: list[FlownTurn] = []
    notes: list[str] = []
    if turning is not None and turning.same:
        turns = [(dive, flight) for dive, flight in flown if dive.turning is not None]
        turned, failed = fly_turns(vehicle, turns, turning, engine)
        notes = [f"on the log's own turns: {error}" for error in failed]
    for phase in PHASES:
        log = phase_figures([s for dive, _ in flown for s in logged_samples(dive, phase, pump)])
        if log is None:
            notes.append(f"no whole {phase} in the log: the figures of that phase are missing")
            continue
        legs = [
            s
            for dive, f in flown
            for s in flown_samples(dive, f, legs_flown(dive, f), phase, vehicle, turning)
        ]
        mine = phase_figures(legs)
        if mine is not None and turned:
            legs = [
                s
                for dive, f, n in turned
                for s in flown_samples(dive, f, n, phase, vehicle, turning)
            ]
            mine = dataclasses.replace(mine, turn_per_actuator=turn_per_actuator(legs))
        angles = [a for d, f in flown if (a := angle_of_attack(d, f, phase)) is not None]
        speed_from = None if log.speed is None else "measured"
        if log.speed is None and angles:
            speed_from = "depth rate and pitch"
            path = math.radians(log.pitch - float(np.mean(angles)))
            log = dataclasses.replace(log, speed=-log.depth_rate / math.sin(path))
            notes.append(
                f"speed of the log in its {phase}s: depth rate over the sine of pitch less the "
                f"twin's angle of attack ({np.mean(angles):.1f} deg); it measured none"
            )
        phases[phase] = PhaseComparison(
            log=log,
            twin=mine,
            speed_from=speed_from,
            same_part=turning is not None and turning.same,
        )
    return phases, notes


def _beside_mujoco(
    vehicle: Vehicle,
    dives: Sequence[ReplayedDive],
    flights: Sequence[Trajectory | SimulationUnstable],
) -> EndsApart:
    """Of the first dive that lanes flew."""
    dive, flight = next(
        (d, f) for d, f in zip(dives, flights, strict=True) if isinstance(f, Trajectory)
    )
    theirs = fly_dives(vehicle, [dive])[0]
    last = len(flight.time) - 1
    if isinstance(theirs, Trajectory):
        last = min(last, len(theirs.time) - 1)
    return ends_apart(float(flight.time[last]), state_at(flight, last), theirs)
