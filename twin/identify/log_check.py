"""Log check: comparison of a vehicle file's twin with logs of the real vehicle, by phase."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twin.checks.agreement import EndsApart, ends_apart, state_at
from twin.errors import SimulationUnstable, StoreError, VehicleError
from twin.identify.calibration import Array, Calibration, load_calibration
from twin.identify.log_figures import (
    FigureSamples,
    PhaseFigures,
    angle_of_attack,
    flown_samples,
    logged_samples,
    phase_figures,
    turn_per_actuator,
)
from twin.identify.log_flight import PATIENCE, FlownTurn, fly_dives, fly_turns, legs_flown
from twin.identify.replayed_dive import (
    LEAST_RANGE,
    PHASES,
    Phase,
    ReplayedDive,
    Turning,
    read_dive,
    turning_of,
)
from twin.records.logged import LogStore, log_rows
from twin.records.reader import MissionStore
from twin.records.trajectory import Trajectory
from twin.vehicle.laws import FlowFrame
from twin.vehicle.vehicle import Vehicle, load_vehicle

DEPTH_RATE_LIMIT = 0.05
"""[1] Largest relative error of the depth rate in each phase"""
TURN_LIMIT = 0.25
"""[1] Largest relative error of the ratio: turn rate over position of the turning part"""
TURNING_LIMIT = 3.0
"""[deg] Largest difference of the turning part's mean position, twin minus log. Beyond it, the
logged vehicle has an asymmetry that the vehicle file lacks"""
HEADING_LIMIT = 2.0
"""[deg] Largest standard deviation of the twin's heading about its target"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PhaseComparison:
    """Numbers of the log and of the twin in one phase."""

    log: PhaseFigures
    twin: PhaseFigures | None
    """Numbers of the twin; None: the twin never flew steadily in this phase"""
    speed_from: str | None
    """Source of the log's speed: "measured", "depth rate and pitch", or None"""
    same_part: bool
    """True if one type of part turns log and twin, so that its effects can be compared"""

    def describe(self) -> dict[str, Any]:
        """Plain values for JSON; ratios are twin / log, differences are twin minus log."""
        log, twin = self.log.describe(), {} if self.twin is None else self.twin.describe()
        twin = {name: twin.get(name) for name in log}
        cycles = {"log": self.log.oscillation, "twin": self.twin and self.twin.oscillation}
        pairs = {name: (twin[name], log[name]) for name in log}
        ratio = {
            name: mine / theirs if mine is not None and theirs else None
            for name, (mine, theirs) in pairs.items()
            if name in ("depth_rate_m_s", "speed_m_s", "turn_per_actuator")
        }
        deviation = {
            name: None if mine is None or theirs is None else mine - theirs
            for name, (mine, theirs) in pairs.items()
            if name.endswith("_deg") and (name != "turning_deg" or self.same_part)
        }
        if not self.same_part:
            ratio["turn_per_actuator"] = None
        return {
            "log": {**log, "parts": dict(self.log.parts)},
            "twin": {**twin, "parts": {} if self.twin is None else dict(self.twin.parts)},
            "speed_from": self.speed_from,
            "ratio": ratio,
            "deviation": deviation,
            "limit_cycle": {n: one and dataclasses.asdict(one) for n, one in cycles.items()},
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogCheck:
    """Comparison of a vehicle file's twin with a store of logs."""

    vehicle: Vehicle
    store: Path
    dives: tuple[ReplayedDive, ...]
    flights: tuple[Trajectory | SimulationUnstable, ...]
    """Flight of the twin for each dive"""
    phases: dict[Phase, PhaseComparison]
    turning: Turning | None
    engine: str
    """Engine that flew the twin"""
    beside_mujoco: EndsApart | None
    """Distance between the ends of the first dive by the batched engine and by MuJoCo; else None"""
    notes: tuple[str, ...]
    """Sentences on signals that the log lacks, and on their replacements"""

    @property
    def beyond(self) -> list[str]:
        """Phrase for each number beyond its limit; empty if the twin flies as the log."""
        flown = list(zip(self.dives, self.flights, strict=True))
        found = [f"dive {dive.row}: {f}" for dive, f in flown if isinstance(f, Exception)]
        for name, phase in self.phases.items():
            found += [f"{name}: {text}" for text in _beyond(phase)]
        short = [
            dive.row
            for dive, f in flown
            if isinstance(f, Trajectory) and f.provenance.get("ended") != "flown"
        ]
        if short:
            found.append(
                f"the twin took more than {PATIENCE:g} times the log's time in {len(short)} of "
                f"{len(self.dives)} dives ({', '.join(map(str, short))})"
            )
        return found

    def describe(self) -> dict[str, Any]:
        """Plain values for JSON."""
        legs = Counter(leg.phase for dive in self.dives for leg in dive.legs if leg.compared)
        beside: dict[str, Any] = {}
        if self.beside_mujoco is not None:
            apart = dataclasses.asdict(self.beside_mujoco)
            beside = {"engine": self.engine, "beside_mujoco": apart}
        return {
            "vehicle": self.vehicle.name,
            "store": str(self.store),
            **beside,
            "dives": len(self.dives),
            "missions": [dive.row for dive in self.dives],
            "legs": {phase: legs[phase] for phase in PHASES},
            "hours": sum(len(d.depth) * d.period for d in self.dives) / 3600.0,
            "turning": self.turning and dataclasses.asdict(self.turning),
            "phases": {name: phase.describe() for name, phase in self.phases.items()},
            "limits": {
                "depth_rate_relative": DEPTH_RATE_LIMIT,
                "turn_per_actuator_relative": TURN_LIMIT,
                "turning_deg": TURNING_LIMIT,
                "heading_sd_deg": HEADING_LIMIT,
            },
            "notes": list(self.notes),
            "beyond": self.beyond,
            "ok": not self.beyond,
        }


def _beyond(phase: PhaseComparison) -> list[str]:
    """Phrase for each number of a phase beyond its limit."""
    twin = phase.twin
    if twin is None:
        return ["the twin never flew it steadily"]
    figures, found = phase.describe(), []
    ratio, turn = (figures["ratio"][name] for name in ("depth_rate_m_s", "turn_per_actuator"))
    if ratio is not None and abs(ratio - 1.0) > DEPTH_RATE_LIMIT:
        found.append(f"depth rate {ratio:.3f} times the log's (within {DEPTH_RATE_LIMIT:.0%})")
    if turn is not None and abs(turn - 1.0) > TURN_LIMIT:
        found.append(f"turn per actuator {turn:.2f} times the log's (within {TURN_LIMIT:.0%})")
    if abs(figures["deviation"].get("turning_deg") or 0.0) > TURNING_LIMIT:
        found.append(
            f"what turns it is at {twin.turning:.1f} deg on the mean, the log's at "
            f"{phase.log.turning:.1f} (within {TURNING_LIMIT:g}): the file flies no such "
            "asymmetry; identify it (`twin identify`)"
        )
    if twin.heading_sd is not None and twin.heading_sd > HEADING_LIMIT:
        found.append(f"heading wanders by {twin.heading_sd:.1f} deg (at most {HEADING_LIMIT:g})")
    if twin.oscillation is not None:
        one = twin.oscillation
        found.append(
            f"{one.signal} swings by {one.amplitude_deg:.1f} deg every {one.period_s:.0f} s and "
            "does not die out"
        )
    return found


def check_logs(
    store: str | Path,
    vehicle: str | Path | Vehicle | Calibration,
    *,
    missions: Sequence[int] | None = None,
    engine: str = "mujoco",
) -> LogCheck:
    """Fly the twin of a vehicle on the targets of logged dives, and compare.

    Args:
      store: path of a store that `factory import` wrote.
      vehicle: shipped name or path of an MJCF file, whose sensor errors are used; a `Vehicle`,
        whose sensors count as exact; or `twin.identify.load_calibration(...)`.
      missions: rows of the store, all by default.
      engine: engine of `Scenario`; with "lanes", MuJoCo flies the first dive too.

    Raises:
      StoreError: no store of logs, no such row, no pitch or pump, or no whole dive in any row.
      VehicleError: no such vehicle, or one without a pump or without a part that pitches it.
      InputError, MissionError: the vehicle cannot fly the log's pitch or pump positions.
      SimulationUnstable: the twin went unstable in every dive.
    """
    hull = _hull(vehicle)
    flown = hull.vehicle
    if hull.thermal_expansion and not flown.hull_thermal_expansion:
        flown = flown.replace(
            hull_thermal_expansion=hull.thermal_expansion, hull_thermal_lag=hull.thermal_lag
        )
    with MissionStore(store) as found:
        if not found.logged:
            raise StoreError(
                f"store {store} is simulated: its missions were flown by the twin already; give a "
                "store of logs (`factory import`), or judge the twin by `twin check` alone"
            )
    with LogStore(store) as logs:
        there = _Present(logs)
        turning = turning_of(hull.vehicle, there)
        rows = list(range(len(logs))) if missions is None else list(missions)
        for row in rows:
            logs.check_mission(row)
        listed = log_rows(logs)
        powered = [row for row in rows if listed[row].powered]
        rows = [row for row in rows if row not in powered]
        _check_signals(logs, there)
        read = [read_dive(logs, row, hull, turning) for row in rows]
        dives = [dive for dive in read if dive is not None]
        if not dives:
            raise StoreError(
                f"store {store} has no whole dive: no mission descends or climbs by "
                f"{LEAST_RANGE:g} m with pitch and pumped volume"
                + f" and without its thruster ({len(powered)} ran it)"
                * bool(powered)
            )
        notes = _notes(logs, there, dives, turning, hull.vehicle)
        if powered:
            names = ", ".join(map(str, powered))
            notes.append(f"left out: {len(powered)} dives ran their thruster ({names})")
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


class _OneDensity(Calibration):
    """Calibration for a `Vehicle` or a hull law other than `FlowFrame`, with one density."""

    def sea_density(self, depth: Array) -> Array:
        """Reference density of the vehicle at every depth."""
        return np.full(np.shape(depth), self.vehicle.reference_density)


def _hull(given: str | Path | Vehicle | Calibration) -> Calibration:
    """Calibration for `check_logs`; a `Vehicle` gets exact sensors and no thermal expansion.

    Raises:
      VehicleError: the vehicle has no pump or no part that pitches it.
    """
    vehicle = given.vehicle if isinstance(given, Calibration) else given
    vehicle = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
    for control, what in (("buoyancy", "pump"), ("pitch", "part that pitches it")):
        if vehicle.steered(control) is None:
            raise VehicleError(
                f"vehicle {vehicle.name!r} has no {what} (its parts: "
                f"{', '.join(vehicle.part_names) or 'none'}): logs are compared with the flight of "
                "a glider; give a glider's file"
            )
    if isinstance(given, Calibration):
        return given
    if isinstance(given, str | Path) and isinstance(vehicle.law, FlowFrame):
        return load_calibration(vehicle)
    water = vehicle.reference_density
    return _OneDensity(vehicle=vehicle, water_density=water, thermal_expansion=0.0, thermal_lag=1.0)


class _Present:
    """Set of a store's signals that have values."""

    def __init__(self, logs: LogStore) -> None:
        self._logs = logs

    def __contains__(self, name: object) -> bool:
        return str(name) in self._logs and bool(np.isfinite(self._logs.array(str(name))).any())


def _check_signals(logs: LogStore, there: _Present) -> None:
    """Raise StoreError for a log without depth, pitch or pump; it names the missing signals."""
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


def _notes(
    logs: LogStore,
    there: _Present,
    dives: Sequence[ReplayedDive],
    turning: Turning | None,
    vehicle: Vehicle,
) -> list[str]:
    """Sentences on signals that the log lacks, and on their replacements."""
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


def _phases(
    vehicle: Vehicle,
    dives: Sequence[ReplayedDive],
    flights: Sequence[Trajectory | SimulationUnstable],
    turning: Turning | None,
    engine: str,
) -> tuple[dict[Phase, PhaseComparison], list[str]]:
    """Numbers of log and twin in each phase of the log, and notes on them."""
    pump = vehicle.steering["buoyancy"]
    pairs = zip(dives, flights, strict=True)
    flown = [(dive, flight) for dive, flight in pairs if isinstance(flight, Trajectory)]
    phases: dict[Phase, PhaseComparison] = {}
    turned: list[FlownTurn] = []
    notes: list[str] = []
    same_part = turning is not None and turning.same
    if turning is not None and same_part:
        turns = [(dive, flight) for dive, flight in flown if dive.turning is not None]
        turned, failed = fly_turns(vehicle, turns, turning, engine)
        notes = [f"on the log's own turns: {error}" for error in failed]
    numbered = [(dive, flight, legs_flown(dive, flight)) for dive, flight in flown]
    for phase in PHASES:

        def of_twin(flights: Sequence[FlownTurn], phase: Phase = phase) -> list[FigureSamples]:
            return [s for one in flights for s in flown_samples(*one, phase, vehicle, turning)]

        log = phase_figures([s for dive, _ in flown for s in logged_samples(dive, phase, pump)])
        if log is None:
            notes.append(f"no whole {phase} in the log: the figures of that phase are missing")
            continue
        mine = phase_figures(of_twin(numbered))
        if mine is not None and turned:
            mine = dataclasses.replace(mine, turn_per_actuator=turn_per_actuator(of_twin(turned)))
        angles = [a for one in numbered if (a := angle_of_attack(*one, phase)) is not None]
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
            log=log, twin=mine, speed_from=speed_from, same_part=same_part
        )
    return phases, notes


def _beside_mujoco(
    vehicle: Vehicle,
    dives: Sequence[ReplayedDive],
    flights: Sequence[Trajectory | SimulationUnstable],
) -> EndsApart:
    """Distance between the ends of the first flown dive by the batched engine and by MuJoCo."""
    pairs = zip(dives, flights, strict=True)
    dive, flight = next((d, f) for d, f in pairs if isinstance(f, Trajectory))
    theirs = fly_dives(vehicle, [dive])[0]
    last = len(flight.time) - 1
    if isinstance(theirs, Trajectory):
        last = min(last, len(theirs.time) - 1)
    return ends_apart(float(flight.time[last]), state_at(flight, last), theirs)
