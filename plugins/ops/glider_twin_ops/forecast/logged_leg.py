"""Logged leg: a dive of a store from fix to fix, with its displacement through the water.

The displacement through the water comes from the first of these sources that a log allows:

- with `--vehicle`, the velocity of that vehicle's flight model, integrated from fix to fix;
- with logged pitch and heading, depth rate / tan(|pitch| + 3 degree) along the heading, from which
  the store has its depth-averaged current;
- in the short logs that come by satellite, displacement over ground less the current that the
  vehicle reported for the dive, times the duration.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin import Origin, estimate_flight
from twin.cli import counted
from twin.geodesy import position
from twin.logs import fixes_at, track_velocity
from twin.navigation.current import Leg
from twin.numbers import Array
from twin.physics import utc_text
from twin.records import LogStore
from twin.records.attributes import DIVE_DURATION
from twin.records.coordinates import utc_clock, utc_minute

AXES = ("north", "east")
READ = ("measured_gps", "measured_onboard", "commanded_waypoint", "measured_current")
"""Signals that are read of each dive, north and east"""
MODEL, PITCH, REPORTED = "flight model", "depth rate and pitch", "reported current"
"""Sources of a displacement through the water"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LoggedLeg:
    """Dive of a store between two fixes."""

    mission: int
    """Row in the store."""
    leg: Leg
    """[s] unix clock; its displacement through the water is known"""
    method: str
    """Source of the displacement: `MODEL`, `PITCH` or `REPORTED`"""
    begin: tuple[float, float]
    """Latitude, longitude [degree] of the fix before"""
    onboard: tuple[float, float] | None
    """North, east [m] to the end of the vehicle's own track; None without one"""
    targets: tuple[tuple[float, float], ...] = ()
    """North, east [m] from the fix before to the commanded waypoints, in order; empty where the log
    has none"""
    believed: tuple[float, float] | None = None
    """North, east [m/s] of the vehicle's current estimate at the begin of the dive; None where the
    log has none"""

    @property
    def velocity(self) -> Array:
        """[m/s] Mean velocity through the water, north and east, (2,)."""
        assert self.leg.velocity is not None  # a leg of a store has a displacement
        return self.leg.velocity

    @property
    def end(self) -> tuple[float, float]:
        """Latitude, longitude [degree] of the fix after."""
        return place_at(self.leg.over_ground, self.begin)

    @property
    def origin(self) -> Origin:
        """Place and time of the fix before."""
        begin = datetime.datetime.fromtimestamp(self.leg.start, datetime.UTC)
        latitude, longitude = self.begin
        return Origin(latitude_deg=latitude, longitude_deg=longitude, time=utc_text(begin))


def pair(values: Array) -> tuple[float, float]:
    """Tuple of the first two numbers, such as north and east."""
    return float(values[0]), float(values[1])


def place_at(metres: Sequence[float] | Array, begin: tuple[float, float]) -> tuple[float, float]:
    """Latitude, longitude [degree] of a place some metres north and east of another."""
    north, east = (np.array([float(value)]) for value in metres)
    latitude, longitude = position(north, east, *begin)
    return float(latitude[0]), float(longitude[0])


def legs_of(
    logs: LogStore, deployment: str, flown: Mapping[int, Array] | None = None
) -> list[LoggedLeg]:
    """Legs of a deployment in order of time, without dives that lack two fixes or a displacement.

    Args:
      flown: velocity through the water by a flight model, north and east [m/s], (time, 2), by row
        in the store; other rows take the log's own velocity.
    """
    durations = logs.number(DIVE_DURATION)
    moved, *currents = (
        np.stack([logs.number(f"{name}_{axis}") for axis in AXES], axis=1)
        for name in ("displacement", "dac", "vehicle_dac")
    )
    found: list[LoggedLeg] = []
    missions = logs.missions_of(deployment)
    names = [f"{name}_{axis}" for name in READ for axis in AXES]
    blocks = {name: logs.rows(name, missions) for name in names if name in logs}
    for k, mission in enumerate(missions):
        duration, ground = float(durations[mission]), moved[mission]
        begin, _ = logs.fixes(mission)
        start, count = float(logs.starts[mission]), int(logs.samples[mission])
        if not (np.isfinite([duration, start, *ground, *begin]).all() and duration > 0.0):
            continue
        if found and start < found[-1].leg.end - 1.0:
            continue
        way, method = None, ""
        if flown and mission in flown:
            velocity = flown[mission]
            way, method = 0.5 * logs.period * (velocity[1:] + velocity[:-1]).sum(axis=0), MODEL
        for kind, values in zip((PITCH, REPORTED), currents, strict=True):
            if way is None and np.isfinite(values[mission]).all():
                way, method = ground - duration * values[mission], kind
        if way is None or not np.isfinite(way).all():
            continue
        absent = np.full(count, np.nan)
        signals = [blocks[name][k, :count] if name in blocks else absent for name in names]
        fixes, onboard, waypoints, known = np.array(signals, float).reshape(len(READ), 2, -1)
        known = known[:, np.isfinite(known).all(axis=0)]
        track = track_velocity(onboard.T, logs.period, fixes_at(fixes.T))  # jumps to fixes removed
        found.append(
            LoggedLeg(
                mission=mission,
                leg=Leg(
                    start=start,
                    duration=duration,
                    over_ground=pair(ground),
                    through_water=pair(way),
                ),
                method=method,
                begin=begin,
                onboard=None if track is None else pair(logs.period * track[:-1].sum(axis=0)),
                targets=_targets(waypoints.T),
                believed=pair(known[:, 0]) if known.size else None,
            )
        )
    return found


class DiveTime(NamedTuple):
    """Times of a dive whose begin and end are known."""

    begin: float
    """[s] unix"""
    end: float
    """[s] unix"""
    stay: float
    """[s] surface interval before the dive; NaN where it is not known"""


class DiveTimes(NamedTuple):
    """Times of all dives of a deployment, and gaps of its log."""

    dives: tuple[DiveTime, ...]
    """Dives from surface to surface in order of time, with or without a known displacement"""
    holes: tuple[tuple[float, float], ...]
    """Begin and end [s] unix of gaps in which the vehicle may have dived"""

    @property
    def silent(self) -> str:
        """Number and times of the gaps, in words; empty without gaps."""
        if not self.holes:
            return ""
        told = [f"{utc_minute(one)} to {utc_clock(end, one)}" for one, end in self.holes[-TOLD:]]
        return (
            f"the log has {counted(len(self.holes), 'hole')} of an hour or more"
            f"{', the last' if len(self.holes) > TOLD else ''}: {', '.join(told)} UTC. A file is "
            "missing or short, and it may have dived then: stays at the surface around holes do "
            "not count"
        )


SILENT, TOLD = 3600.0, 3
"""SILENT: [s] time without a sample that counts as a gap, as in `factory import`. TOLD: number of
last gaps that are reported with their times"""
AFLOAT, SAME = 3.0, 1.5
"""AFLOAT: [m] deepest reading of a pressure sensor at the surface. SAME: [s] largest difference of
two durations of one surface interval, since clocks are rounded"""


def dive_times(logs: LogStore, deployment: str) -> DiveTimes:
    """Times of the dives of a deployment.

    The time between two dives is a surface interval if fixes begin and end it, and if the log has
    no gap in it or the usual dive is too long for it. Otherwise a file may be missing, and the
    interval is not known. A dive whose log begins or ends under water was longer and is left out.
    """
    durations, waited = (logs.number(name) for name in (DIVE_DURATION, "surface_duration"))
    dives: list[DiveTime] = []
    holes: list[tuple[float, float]] = []
    before, fixed = math.nan, False
    for row in logs.missions_of(deployment):
        begin, end = float(logs.starts[row]), float(logs.starts[row] + durations[row])
        if not end > begin:
            continue
        begun, ended = (bool(np.isfinite(fix).all()) for fix in logs.fixes(row))
        gap, told = begin - before, float(np.nan_to_num(waited[row]))
        usual = usual_duration(dives) if dives else 0.0
        known = fixed and begun and (abs(gap - told) < SAME or gap < usual)
        if not known and gap - told >= SILENT:
            holes.append((before, begin - told))
        depth = logs.signal("measured_depth", row)
        depth = depth[np.isfinite(depth)]  # at the surface at both ends, by depth
        if (begun and ended) or (depth.size and max(depth[0], depth[-1]) < AFLOAT):
            dives.append(DiveTime(begin, end, gap if known else math.nan))
        before, fixed = end, ended
    return DiveTimes(tuple(dives), tuple(holes))


def usual_duration(before: Sequence[DiveTime]) -> float:
    """[s] Median duration of the last three dives."""
    return float(np.median([one.end - one.begin for one in before[-3:]]))


def why_no_legs(logs: LogStore, deployment: str) -> str:
    """Reason in words why a deployment has no leg."""
    rows = logs.missions_of(deployment)
    begun, ended = np.isfinite([logs.fixes(row) for row in rows]).all(axis=2).sum(axis=0).tolist()
    if moved := int(np.isfinite(logs.number("displacement_north")[rows]).sum()):
        return (
            f"deployment {deployment!r} has {counted(moved, 'dive')} from GPS fix to "
            "GPS fix, but no way through the water (pitch and heading, a vehicle's own current, or "
            "--vehicle with a flight model)"
        )
    return (
        f"no dive has GPS fixes at both ends: of {counted(len(rows), 'dive')} of deployment "
        f"{deployment!r} {begun} begin{'s' * (begun == 1)} with one and {ended} "
        f"end{'s' * (ended == 1)}"
    )


APART = 30.0
"""[m] Smallest distance of two waypoints: at less, one waypoint was repeated with a correction"""


def _targets(places: Array) -> tuple[tuple[float, float], ...]:
    """Waypoints that were commanded during a dive, in order."""
    places = places[np.isfinite(places).all(axis=1)]
    new = np.append(True, (np.diff(places, axis=0) != 0.0).any(axis=1))[: len(places)]
    found: list[tuple[float, float]] = []
    for north, east in places[new].tolist():
        if not found or math.dist((north, east), found[-1]) > APART:
            found.append((north, east))
    return tuple(found)


def flown_velocities(
    store: Path, vehicle: str | None, missions: list[int] | None = None
) -> dict[int, Array]:
    """Velocity through the water [m/s], (time, 2), by a vehicle's flight model, by row.

    Raises:
      TwinError: the flight model cannot be applied to this store.
    """
    flight = estimate_flight(store, vehicle, missions=missions, thermal_lag=False)
    return {
        one.dive.mission: one.dive.velocity for one in flight.missions if one.dive.tells_current
    }
