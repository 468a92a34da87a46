"""Logged missions: one trajectory with the corrected track and the flight model's velocities.

Figures and films show it like a simulated mission; see `twin.records.logged`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.geodesy import offset
from twin.logs.corrected_track import DiveCurrent
from twin.logs.flight_estimate import MissionFlight, estimate_flight
from twin.records.coordinates import METHOD, METHODS, START_LATITUDE, START_LONGITUDE
from twin.records.logged import AVERAGED, MEASURED, LoggedTrajectory, LogStore
from twin.records.schema import VARIABLES
from twin.records.storage.store_path import StorePath
from twin.records.store import read_trajectory
from twin.records.trajectory import actuator_names
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

POSITION = ("north", "east")
BODY = ("surge", "sway", "heave")
COPIED = (
    *("depth", "roll", "pitch", "heading", "roll_rate", "pitch_rate", "yaw_rate"),
    *("temperature", "salinity", "density"),
)
"""Measured signals that serve as true signals, unchanged or corrected"""
CORRECTED, RECKONED = "corrected track", "dead-reckoned track"
ON_BOARD, STRAIGHT = "on-board track", "straight line between fixes"
STORED = {
    METHODS["onboard_track"]: f"corrected {ON_BOARD}",
    METHODS["depth_rate_and_pitch"]: CORRECTED,
    METHODS["straight_line"]: STRAIGHT,
}
"""Name of a track, by the method that gave a store's latitude and longitude"""
DOPPLER, PROFILED, MODEL = "Doppler log", "current profiler", "flight model"
PROFILER = "profiler's current"
SIMULATED, LOGGED = "simulated truth", "reference of the log"
"""Sources of `true_` signals. SIMULATED: in simulated logs. LOGGED: a log's own reference"""
LAG_CORRECTED = f"{MEASURED}, thermal lag corrected"
SAME = 2e-3
"""[1], [kg/m3] Largest rounding difference from the stored salinity and density"""
MOST_LISTED = 6
"""Maximum number of deployments that an error message lists"""
BREAK = 1.5
"""Gap between two missions, in sample periods, from which plotted lines break"""


class _Part(NamedTuple):
    """One mission: its signals, and the sources of its `true_` signals."""

    start: float
    time: Array
    signals: dict[str, Array]
    sources: dict[str, str]
    place: tuple[float, float]


def logged_trajectory(
    store: str | StorePath,
    missions: Sequence[int] = (0,),
    vehicle: str | Path | Vehicle | None = None,
) -> LoggedTrajectory:
    """Missions of a store of logs, in order of time, as one trajectory.

    Args:
      store: path of the store.
      missions: rows of the store; several must belong to one deployment.
      vehicle: as in `estimate_flight`; default the shipped vehicle of the log's type. For a vehicle
        without a flight model, the track is the store's latitude and longitude, corrected at the
        fixes. Stores of earlier versions give the track that was logged on board.

    Raises:
      StoreError: no store of logs, or no such mission. VehicleError: no such vehicle.
      InputError: missions of several deployments, or a mission without depth.
    """
    logs = LogStore(store)
    if not missions:
        raise InputError("name at least one mission")
    for mission in missions:
        logs.check_mission(mission)
    rows: dict[str, list[int]] = {}
    for mission in sorted(set(missions)):
        rows.setdefault(logs.deployments[mission], []).append(mission)
    if len(rows) > 1:
        listed = [f"{name}: --missions {_ranges(those)}" for name, those in rows.items()]
        more = f"; and {len(rows) - MOST_LISTED} more" if len(rows) > MOST_LISTED else ""
        raise InputError(
            f"missions of {len(rows)} deployments are not one track; choose those of one: "
            f"{'; '.join(listed[:MOST_LISTED])}{more}"
        )
    ordered = sorted(dict.fromkeys(missions), key=lambda k: (logs.starts[k], k))
    flown, currents, flier, reason = _fly(store, ordered, vehicle)
    parts = [
        _part(logs, mission, flown.get(mission), [c for c in currents if c.mission == mission])
        for mission in ordered
    ]
    joined = _join(parts, logs.period, dict(read_trajectory(store, ordered[0]).provenance))
    return dataclasses.replace(joined, vehicle=flier, unflown=reason)


def _ranges(rows: Sequence[int]) -> str:
    """Increasing mission numbers as --missions takes them, such as 0-9,11."""
    runs: list[list[int]] = []
    for row in rows:
        if runs and row == runs[-1][-1] + 1:
            runs[-1].append(row)
        else:
            runs.append([row])
    return ",".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)


def _fly(
    store: str | StorePath, missions: list[int], vehicle: str | Path | Vehicle | None
) -> tuple[dict[int, MissionFlight], list[DiveCurrent], str | None, str]:
    """Flight of the missions; or nothing and the reason, if no shipped model flies the log."""
    try:
        found = estimate_flight(store, vehicle, missions=missions)
    except InputError as error:
        if vehicle is not None:
            raise
        return {}, [], None, str(error)
    flown = {one.dive.mission: one for one in found.missions if one.dive.mission in found.flown}
    return flown, list(found.currents), found.calibration.vehicle.name, ""


def _part(
    logs: LogStore, mission: int, flown: MissionFlight | None, currents: list[DiveCurrent]
) -> _Part:
    count = int(logs.samples[mission])
    logged = [name for name in logs.signals() if np.isfinite(logs.signal(name, mission)).any()]
    signals = {name: logs.signal(name, mission) for name in logged}
    if "measured_depth" not in signals:
        raise InputError(f"mission {mission} of {logs.path} has no depth: there is nothing to draw")
    sources: dict[str, str] = {}

    def put(name: str, values: Array, source: str) -> None:
        signals[f"true_{name}"], sources[f"true_{name}"] = values, source

    for name in logged:
        if name.startswith("true_"):
            sources[name] = _reference(name, logs, "true_current_north" in logged)
    for name in (*COPIED, *actuator_names(VARIABLES)):
        if f"measured_{name}" in signals and f"true_{name}" not in signals:
            put(name, signals[f"measured_{name}"], MEASURED)
    track, source = _track(logs, mission, flown)
    if track is not None:
        for name, values in zip(POSITION, track.T, strict=True):
            put(name, values, source)
            put(f"velocity_{name}", np.gradient(values, logs.period), source)
        put("velocity_down", np.gradient(signals["measured_depth"], logs.period), MEASURED)
    if flown is not None:
        motion = flown.dive.motion
        if motion is not None and not all(f"true_{name}" in signals for name in BODY):
            for name in BODY:
                put(name, getattr(motion, name), MODEL)
        ctd = flown.dive.ctd
        if ctd is not None:
            for name in ("salinity", "density"):
                if f"measured_{name}" not in signals:
                    continue
                changed = getattr(ctd, name)
                same = np.allclose(changed, signals[f"measured_{name}"], atol=SAME, equal_nan=True)
                put(name, changed, MEASURED if same else LAG_CORRECTED)
    if "true_current_north" not in signals and currents:
        for name in POSITION:
            values = np.full(count, np.nan)
            for one in currents:
                values[one.first : one.last + 1] = getattr(one, name)
            put(f"current_{name}", values, AVERAGED)
    return _Part(
        start=float(logs.starts[mission]),
        time=logs.period * np.arange(count, dtype=float),
        signals=signals,
        sources=sources,
        place=logs.fixes(mission)[0],
    )


def _reference(name: str, logs: LogStore, profiled: bool) -> str:
    """Source of a `true_` signal that the log itself holds.

    Args:
      profiled: the log holds currents, so its velocities come from a profiler.
    """
    if logs.simulated:
        return SIMULATED
    if name.startswith("true_current"):
        return PROFILER
    if name.removeprefix("true_") in (*BODY, "speed"):
        return PROFILED if profiled else DOPPLER
    return LOGGED


def _track(logs: LogStore, mission: int, flown: MissionFlight | None) -> tuple[Array | None, str]:
    """North and east [m] of a mission, (time, 2), and their source; None without a position."""
    if flown is not None:
        return flown.position, CORRECTED if len(flown.fixes) else RECKONED
    origin = logs.fixes(mission)[0]
    if METHOD in logs and np.isfinite(origin).all():
        latitude, longitude, how = logs.positions(mission)
        if how in STORED and np.isfinite(latitude).any():
            return np.stack(offset(latitude, longitude, *origin), axis=1), STORED[how]
    onboard = [logs.signal(f"measured_onboard_{name}", mission) for name in POSITION]
    if all(np.isfinite(values).any() for values in onboard):
        return np.stack(onboard, axis=1), ON_BOARD
    moved = np.array([logs.number(f"displacement_{name}")[mission] for name in POSITION])
    if np.isfinite(moved).all():
        share = np.linspace(0.0, 1.0, int(logs.samples[mission]))
        return share[:, None] * moved, STRAIGHT
    return None, ""


def _join(parts: list[_Part], period: float, provenance: dict[str, object]) -> LoggedTrajectory:
    """Join the missions in order of time, each moved to the frame of the first.

    One sample of NaN stands between two missions with a gap: plotted lines break there.
    """
    first = parts[0]
    if len(parts) > 1 and not all(np.isfinite([one.start, *one.place]).all() for one in parts):
        raise InputError(
            "missions without a time and a fix at their start cannot be drawn together; draw them "
            "one by one"
        )
    names = list(dict.fromkeys(name for one in parts for name in one.signals))
    pieces: list[tuple[Array, dict[str, Array]]] = []
    sources: dict[str, dict[str, None]] = {}
    starts, count, end = [], 0, -np.inf
    for one in parts:
        time = one.time + (one.start - first.start if len(parts) > 1 else 0.0)
        if np.isfinite(end) and time[0] - end > BREAK * period:
            pieces.append((np.array([0.5 * (end + time[0])]), {}))
            count += 1
        fresh = time > end  # clocks may overlap by the rounding of times
        starts.append(count)
        pieces.append((time[fresh], {n: v[fresh] for n, v in _moved(one, first).items()}))
        count, end = count + int(fresh.sum()), float(time[-1])
        for name, source in one.sources.items():
            sources.setdefault(name, {})[source] = None
    if START_LATITUDE not in provenance and np.isfinite(first.place).all():
        provenance |= dict(zip((START_LATITUDE, START_LONGITUDE), first.place, strict=True))
    return LoggedTrajectory(
        time=np.concatenate([time for time, _ in pieces]),
        signals={
            name: np.concatenate([s.get(name, np.full(len(t), np.nan)) for t, s in pieces])
            for name in names
        },
        states=np.zeros((0, 0)),
        provenance=provenance,
        sources={name: " or ".join(named) for name, named in sources.items()},
        starts=tuple(starts),
    )


def _moved(one: _Part, first: _Part) -> dict[str, Array]:
    """Signals of a mission, moved to the frame of the first mission."""
    if one is first:
        return one.signals
    latitude, longitude = (np.float64(degrees) for degrees in one.place)
    away = dict(zip(POSITION, offset(latitude, longitude, *first.place), strict=True))
    moved = {f"{kind}_{name}": metres for kind in PLACES for name, metres in away.items()}
    return {name: values + moved.get(name, 0.0) for name, values in one.signals.items()}


PLACES = ("true", "measured_gps", "measured_onboard")
"""Prefixes of positions in a mission's frame"""
