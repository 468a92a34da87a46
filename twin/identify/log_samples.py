"""Samples: the legs of a logged dive and of the twin's flight of it, in one form.

It names the signals that a store of logs needs for a comparison, and reports those that it lacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.identify.heading_leg import HeadingLeg, Phase, Turning
from twin.identify.log_figures import FigureSamples
from twin.identify.log_flight import legs_flown
from twin.identify.replayed_dive import PUMP_REST, ReplayedDive, Target
from twin.records.logged import LogStore
from twin.records.reader import MissionStore
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

UNDER_WATER = 3.0
"""[m] above this a hull is in the waves or partly out of the water"""


def logged_samples(dive: ReplayedDive, phase: Phase, pump: str) -> list[FigureSamples]:
    """The compared legs of a dive as logged; `pump` is the name of the vehicle's."""
    found = []
    rate = np.gradient(dive.depth, dive.period)
    for target in dive.targets:
        leg = target.leg
        if leg.phase != phase or not leg.compared:
            continue
        part = leg.samples
        wanted = None if dive.heading_target is None else dive.heading_target[part]
        heading = None if dive.heading is None else dive.heading[part]
        measured = dive.measured[part] & (dive.depth[part] > UNDER_WATER)
        positions = {name: values[part] for name, values in dive.positions.items()}
        found.append(
            FigureSamples(
                period=dive.period,
                depth_rate=rate[part],
                pitch=dive.pitch[part],
                roll=None if dive.roll is None else dive.roll[part],
                heading=heading,
                heading_error=_error(heading, wanted),
                heading_target=wanted,
                first_error=_first_error(heading, wanted),
                speed=None if dive.speed is None else dive.speed[part],
                turning=None if dive.turning is None else dive.turning[part],
                positions=positions,
                steady=measured & _steady(dive.depth[part], leg, target, positions.get(pump)),
            )
        )
    return found


def flown_samples(
    dive: ReplayedDive,
    trajectory: Trajectory,
    number: Array,
    phase: Phase,
    vehicle: Vehicle,
    turning: Turning | None,
) -> list[FigureSamples]:
    """The same legs as the twin flew them; without those that it did not come to.

    `number` is the leg that it flew at each sample, (time,).
    """
    pump = vehicle.steering["buoyancy"]
    period = float(np.median(np.diff(trajectory.time)))
    found = []
    for k, target in enumerate(dive.targets):
        leg = target.leg
        flown = np.flatnonzero(number == k)
        if leg.phase != phase or not leg.compared or len(flown) < 2:
            continue
        part = slice(flown[0], flown[-1] + 1)
        depth = trajectory["true_depth"][part]
        heading = np.rad2deg(np.unwrap(np.deg2rad(trajectory["true_heading"][part])))
        wanted = None if dive.heading_target is None else trajectory["commanded_heading"][part]
        positions = {name: trajectory[f"true_{name}"][part] for name in vehicle.part_names}
        measured = depth > UNDER_WATER
        found.append(
            FigureSamples(
                period=period,
                depth_rate=np.gradient(depth, period),
                pitch=trajectory["true_pitch"][part],
                roll=trajectory["true_roll"][part],
                heading=heading,
                heading_error=_error(heading, wanted),
                heading_target=wanted,
                first_error=_first_error(heading, wanted),
                speed=np.linalg.norm(trajectory.v_rel[part], axis=1),
                turning=None if turning is None else turning.sense * positions[turning.part],
                positions=positions,
                steady=measured & _steady(depth, leg, target, positions[pump]),
            )
        )
    return found


def angle_of_attack(dive: ReplayedDive, trajectory: Trajectory, phase: Phase) -> float | None:
    """Mean angle of attack [deg] of the twin in the bands of a phase's legs; None off them."""
    number = legs_flown(dive, trajectory)
    found = []
    for k, target in enumerate(dive.targets):
        if target.leg.phase == phase and target.leg.compared:
            shallow, deep = target.leg.band
            depth = trajectory["true_depth"]
            use = (number == k) & (depth >= shallow) & (depth <= deep)
            v_rel = trajectory.v_rel[use]
            found.append(np.rad2deg(np.arctan2(v_rel[:, 2], v_rel[:, 0])))
    angles = np.concatenate([*found, np.zeros(0)])
    return float(angles.mean()) if angles.size else None


def _steady(depth: Array, leg: HeadingLeg, target: Target, pump: Array | None) -> Mask:
    shallow, deep = leg.band
    steady: Mask = (depth >= shallow) & (depth <= deep)
    return steady if pump is None else steady & (np.abs(pump - target.pump) <= PUMP_REST)


def _error(heading: Array | None, wanted: Array | None) -> Array | None:
    """Heading less its target [deg], within +-180."""
    if heading is None or wanted is None:
        return None
    return np.asarray((heading - wanted + 180.0) % 360.0 - 180.0)


def _first_error(heading: Array | None, wanted: Array | None) -> float:
    error = _error(heading, wanted)
    return 0.0 if error is None else float(error[0])


class Present:
    """The signals of a store that have a value."""

    def __init__(self, logs: LogStore) -> None:
        self._logs = logs

    def __contains__(self, name: object) -> bool:
        return str(name) in self._logs and bool(np.isfinite(self._logs.array(str(name))).any())


def check_logged(store: str | Path) -> None:
    """Refuse a store of simulated missions."""
    with MissionStore(store) as found:
        if not found.logged:
            raise StoreError(
                f"store {store} is simulated: its missions were flown by the twin already; give a "
                "store of logs (`factory import`), or judge the twin by `twin check` alone"
            )


def check_signals(logs: LogStore, rows: Sequence[int]) -> None:
    """Refuse a log without what a glide needs, by the names of signals."""
    there = Present(logs)
    for names, why in (
        (("measured_depth",), "depth, so its dives are unknown"),
        (("measured_pitch",), "pitch, so its glides are unknown"),
        (("measured_pump", "commanded_pump"), "pumped volume, so what drove it is unknown"),
    ):
        if not any(name in there for name in names):
            raise StoreError(
                f"store {logs.path}: the log has no {why} ({' nor '.join(names)}); check another "
                "log of this vehicle"
            )


def notes_of(
    logs: LogStore, dives: Sequence[ReplayedDive], turning: Turning | None, vehicle: Vehicle
) -> list[str]:
    """What the log lacks, and what stands in for it."""
    there = Present(logs)
    notes = []
    if logs.simulated:
        notes.append("the log itself is marked as simulated")
    names = list(dict.fromkeys(logs.deployments[dive.row] for dive in dives))
    if len(names) > 1:
        notes.append(
            f"the dives are of {len(names)} deployments ({', '.join(names)}): one vehicle file "
            "fits them only if one vehicle made them; choose with --missions"
        )
    if "measured_heading" not in there:
        notes.append("the log has no heading: the twin holds its own, and turns are not compared")
    elif "commanded_heading" not in there:
        notes.append(
            "the log has no heading setpoint: the target is the running mean of its heading over "
            "15 min"
        )
    if "measured_density" not in there:
        notes.append(
            "the log has no density: the water is the vehicle file's, which decides the depth rate"
        )
    if "measured_pump" not in there:
        notes.append("the log has no measured pump position: the commanded one stands for it")
    if turning is None:
        notes.append(f"vehicle {vehicle.name!r} has no part that turns it")
    elif turning.signal is None:
        notes.append("the log has no position of what turned it: turns per position are not known")
    elif not turning.same:
        notes.append(
            f"the log turned by {turning.signal.removeprefix('measured_')}, vehicle "
            f"{vehicle.name!r} turns by its {turning.part}: their effects cannot be compared"
        )
    return notes
