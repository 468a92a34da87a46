"""Request: inputs of a forecast, checked before anything is flown, and what is known at its start.

`Known` is the state at the start. Its pool has models of the current, one of them a filter.
Without logs the filter has its prior (mean current, eddies, tide, inertial oscillation, speed and
compass: `twin.navigation.current.CurrentParameters`). With logs, models and weights have learned
from the fixes of the last deployment.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from glider_twin_ops.forecast.expected_dive import GroundPool, Rhythm, WayPool
from glider_twin_ops.forecast.logged_leg import (
    MODEL,
    dive_times,
    flown_velocities,
    legs_of,
    pair,
    place_at,
    why_no_legs,
)
from glider_twin_ops.forecast.pool import FILTER, CurrentPool
from glider_twin_ops.forecast.walk import walk
from twin import Mission, Origin, Vehicle, Waypoint
from twin.cli import counted
from twin.errors import InputError, MissionError, StoreError, unknown_name
from twin.geodesy import great_circle
from twin.mission import built_for, check_depth
from twin.navigation import chi_squared
from twin.navigation.current import CurrentFilter
from twin.physics import ENGINES, parse_place, utc_text
from twin.records import LogStore, unix_seconds
from twin.records.coordinates import utc_minute
from twin.water.current import Current

HOUR, DAY = 3600.0, 86400.0
FIELD_ERROR = 0.1
"""[m/s] Standard deviation of a forecast field's depth-averaged current, north and east each, as
found between models of shelf seas and gliders"""
LONGEST_HOURS, LEAST_MEMBERS, MOST_MEMBERS = 240.0, 10, 100_000
FASTEST, SLOWEST = 3.0, 0.1
"""[m/s] FASTEST: largest speed over ground, a glider's plus a current of 2 m/s. SLOWEST: smallest
vertical velocity of a climb, which gives the flight time beyond the horizon"""
LATE = 0.25
"""[1] Fraction of a dive by which late members surface after the others"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Request:
    """Inputs of a forecast: vehicle, mission, start, water, number of members."""

    vehicle: Vehicle
    mission: Mission
    place: Origin
    """Place and time of the start."""
    hours: float = 12.0
    """[h] Horizon."""
    members: int = 200
    field: Current | None = None
    """Forecast of the current; None: the models continue the current found in the logs."""
    field_error: float = FIELD_ERROR
    """[m/s] Standard deviation of the field's error, north and east each."""
    density: str = "usual"
    """Water column, as in `twin simulate --density`."""
    energy_left_kwh: float | None = None
    """[kW h] Energy left in the batteries; None: the days left are not reported."""
    seed: int = 0
    engine: str = "lanes"
    """Engine of the members, as `Scenario.engine`."""

    def __post_init__(self) -> None:
        check_members(self.members, self.engine)
        check_hours(self.hours)
        for name, least, most in (("field_error", 0.0, 5.0), ("energy_left_kwh", 0.0, 1e4)):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and least < value <= most):
                raise InputError(f"forecast: {name} = {value:g} must be above 0, at most {most:g}")
        if self.seed < 0:
            raise InputError(f"forecast: seed = {self.seed} must be at least 0")
        if self.place.time is None:
            raise InputError("forecast: the start has no time: give LAT,LON,TIME")
        if self.mission.needs_floor:
            raise MissionError(
                f"mission {self.mission.name!r} goes by {self.mission.needs_floor}, and a forecast "
                f"has no sea floor: leave {self.mission.needs_floor} out"
            )
        self.notes()  # raises MissionError for a target beyond the plane of the start
        check_depth(self.deepest, self.vehicle)

    def notes(self) -> tuple[str, ...]:
        """Warnings about depth and targets; MissionError for a target beyond the start's plane."""
        said = []
        placed = self.mission.placed(self.place.latitude_deg, self.place.longitude_deg)
        if isinstance(first := placed.segments[0], Waypoint):
            away = math.hypot(first.targets[0]["north_m"], first.targets[0]["east_m"])
            if away <= first.arrival_radius_m:
                said.append(
                    f"already within {first.arrival_radius_m:g} m of target 1 ({away:.0f} m): it "
                    "counts as reached at the start"
                )
            elif away > FASTEST * max(self.horizon, DAY):
                span = f"{self.hours:g} h" if self.horizon > DAY else "a day"
                said.append(
                    f"target 1 is {away / 1e3:.0f} km away, farther than anything goes in "
                    f"{span}: is it the place that is meant?"
                )
        rated, deepest = built_for(self.vehicle), self.deepest
        if deepest > rated:
            known = (
                f"{self.vehicle.name} is built for {rated:g} m"
                if self.vehicle.rated_depth
                else f"no vehicle that is known here is built for more than {rated:g} m; yours "
                'has it as <numeric name="rated_depth" data="METRES"/> in its file'
            )
            said.append(
                f"dives to {deepest:g} m, and {known}: the forecast flies them though nothing may "
                "come up from there; give a depth that it is built for"
            )
        return tuple(said)

    @property
    def deepest(self) -> float:
        """[m] Largest depth of the mission."""
        return self.mission.deepest

    @property
    def horizon(self) -> float:
        """[s] Time within which surfacings are reported."""
        return HOUR * self.hours

    @property
    def flown(self) -> float:
        """[s] Duration of members' flights, beyond the horizon until late members have surfaced."""
        return self.horizon + self.deepest / SLOWEST + LATE * longest_dive(self.mission)


def check_members(members: int, engine: str = "lanes") -> None:
    """Raise InputError for an unknown engine and for too few or too many members."""
    if engine not in ENGINES:
        raise InputError(unknown_name("engine", str(engine), ENGINES))
    if not LEAST_MEMBERS <= members <= MOST_MEMBERS:
        raise InputError(
            f"forecast: members = {members} must be from {LEAST_MEMBERS} to {MOST_MEMBERS}: fewer "
            "say nothing of an ellipse"
        )


def check_hours(hours: float) -> None:
    """Raise InputError for a horizon of 0 or beyond `LONGEST_HOURS`."""
    if not 0.0 < hours <= LONGEST_HOURS:
        raise InputError(f"forecast: hours = {hours:g} must be above 0, at most {LONGEST_HOURS:g}")


def mission_to(
    goto: str, *, depth: float, pitch_deg: float, surface_after_s: float, radius: float
) -> Mission:
    """Mission to the places of a text "LAT,LON[;LAT,LON ...]".

    Raises:
      MissionError: a place cannot be read, or depth or pitch is impossible.
    """
    targets = []
    for part in goto.split(";"):
        try:
            latitude, longitude = (float(word) for word in part.split(","))
        except ValueError:
            raise MissionError(
                f"goto {part.strip()!r}: write LAT,LON in degrees, with ; between places, such as "
                "36.9,-122.5;37,-122.6"
            ) from None
        targets.append({"latitude": latitude, "longitude": longitude})
    segment = Waypoint(
        targets=tuple(targets),
        max_depth_m=depth,
        pitch_deg=pitch_deg,
        surface_after_s=surface_after_s,
        arrival_radius_m=radius,
    )
    return Mission(name="goto", segments=(segment,))


def longest_dive(mission: Mission) -> float:
    """[s] Longest commanded time between a mission's surfacings; 3 h if none is commanded."""
    times = [getattr(segment, "surface_after_s", None) for segment in mission.segments]
    return max((time for time in times if time is not None), default=3.0 * HOUR)


KILO = 1e3
OLD, FAR, MOST_BEFORE = 2.0, 30.0, 60.0
"""OLD: [d] age and FAR: [km] distance of logs that give a warning, because eddies and tides change.
MOST_BEFORE: [s] largest difference of clocks"""
MOST_DAYS, MOST_AWAY, MOST_PER_DAY = 30.0, 100.0, 100.0
"""Limits beyond which logs are refused. MOST_DAYS: [d] age. MOST_AWAY: [km] distance. MOST_PER_DAY:
[km/d] its growth; a glider drifts at less than 1.2 m/s"""


class LastSeen(NamedTuple):
    """Newest sample of a log: the next surfacing is later."""

    time: float
    """[s] unix"""
    depth: float
    """[m]"""
    rise: float
    """[s] Time to rise from `depth` at the median vertical velocity of the dive."""

    @property
    def words(self) -> str:
        """Depth, time and rise in words."""
        return (
            f"the log has it at {self.depth:.0f} m at {utc_minute(self.time)} UTC: it comes up "
            f"{self.rise / 60.0:.0f} min later at the earliest"
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Known:
    """State at the last fix of the logs; without logs most fields are None or empty."""

    pool: CurrentPool
    """Models of the current at the last fix, on the unix clock."""
    place: tuple[float, float] | None = None
    """Latitude, longitude [degree] of the last fix."""
    time: float | None = None
    """[s] Unix time of the last fix."""
    last_current: tuple[float, float] | None = None
    """[m/s] Mean current over the last dive, north and east, as estimated on board."""
    source: str = "no logs"
    """Source of the state in words."""
    legs: int = 0
    """Number of dives from which the models learned."""
    ways: WayPool | None = None
    """Models of the velocity through the water."""
    ground: GroundPool | None = None
    """Models of the velocity over ground."""
    reach: float = chi_squared(0.9)
    """[1] Squared Mahalanobis radius that held nine of ten surfacings of the log, each forecast
    from the dives before it."""
    rhythm: Rhythm | None = None
    """Surface intervals and durations; None: not known."""
    silent: str = ""
    """Gaps of the log in words; empty without gaps"""
    last_seen: LastSeen | None = None
    """Newest sample of the log, if it is newer than the last fix"""
    by_model: bool = False
    """True if the vehicle's flight model gave the displacements through the water; the filter then
    estimates this model's errors of speed and compass."""

    @property
    def filter_(self) -> CurrentFilter:
        """Current filter of the pool; it also estimates the errors of speed and compass."""
        return self.pool.filters[FILTER]

    def at(self, time: float) -> Known:
        """Propagate the current filter to a unix time [s].

        Raises:
          InputError: the time is more than a minute before the last fix.
        """
        wait = time - self.filter_.time
        if wait < -MOST_BEFORE:
            raise InputError(
                f"the forecast would begin {-wait / 3600.0:.1f} h before the last fix of the logs: "
                "give a later --from, or leave it out to begin at that fix"
            )
        if wait > 0.0:
            self.filter_.step(wait, None)
        return self

    def check_begin(self, latitude: float, longitude: float, time: float) -> str:
        """Check that the logs are near a place [degree] and a unix time [s].

        Returns:
          A warning if the logs are old or from far away; else empty.

        Raises:
          InputError: the logs are too old, or from farther away than a glider goes since then.
        """
        if self.place is None or self.time is None:
            return ""
        days = max(time - self.time, 0.0) / DAY
        away = great_circle(latitude, longitude, *self.place) / KILO
        said = (
            f"the last fix of the logs is {days:.1f} days before the forecast and {away:.0f} km "
            f"from its start ({self.source})"
        )
        if days > MOST_DAYS or away > MOST_AWAY + MOST_PER_DAY * days:
            raise InputError(
                f"{said}: they do not describe this water; give logs of the deployment that goes "
                "on, or leave --logs out"
            )
        if days > OLD or away > FAR:
            return f"{said}: the current in them may not hold"
        return ""


def known_without_logs(latitude: float, time: float) -> Known:
    """State without logs, by the priors, at a latitude [degree] and a unix time [s]."""
    return Known(pool=CurrentPool(latitude=latitude, time=time))


def known_from_logs(path: str | Path, vehicle: str | None = None) -> Known:
    """Learn the state from a store of logs: its last deployment with a dive from fix to fix.

    Args:
      path: store that `factory import` wrote.
      vehicle: flight model for the velocity through the water, a file or a shipped name; None:
        depth rate and pitch, or the vehicle's reported current.

    Raises:
      StoreError: no store of logs, or no dive with two fixes and a known displacement.
      VehicleError: no such vehicle.
    """
    with LogStore(Path(path)) as logs:
        deployment, later = _last_deployment(logs)
        flown = None
        if vehicle is not None:
            flown = flown_velocities(Path(path), vehicle, logs.missions_of(deployment))
        legs = legs_of(logs, deployment, flown)
        if not legs:
            raise StoreError(
                f"store {path}: {why_no_legs(logs, deployment)}; nothing is known of the current: "
                "give --from, and leave --logs out"
            )
        times = dive_times(logs, deployment)
        seen = _last_seen(logs, deployment)
    walked = walk(legs, dives=times.dives)
    last = legs[-1]
    return Known(
        pool=walked.pool,
        place=last.end,
        time=last.leg.end,
        last_current=pair(last.leg.current),
        source=f"{counted(len(legs), 'dive')} from fix to fix of {deployment} (way through the "
        f"water: {last.method})" + (f"; no dive of {later} ends with a fix" if later else ""),
        legs=len(legs),
        reach=walked.reach[1],
        ways=walked.ways,
        ground=walked.ground,
        rhythm=walked.rhythm,
        silent=times.silent,
        last_seen=seen if seen is not None and seen.time > last.leg.end else None,
        by_model=vehicle is not None and all(one.method == MODEL for one in legs),
    )


def aim_of(path: str | Path) -> str:
    """Last commanded waypoint "LAT,LON" of a store's last dive; empty if it has none.

    Raises:
      StoreError: no store of logs.
    """
    with LogStore(Path(path)) as logs:
        legs = legs_of(logs, _last_deployment(logs)[0])
    if not legs or not legs[-1].targets:
        return ""
    latitude, longitude = place_at(legs[-1].targets[-1], legs[-1].begin)
    return f"{latitude:.4f},{longitude:.4f}"


def begun(start: Origin | str | None, known: Known | None) -> tuple[Origin, Known, str]:
    """Start of a forecast, the state there, and a warning where the logs are old or far away.

    Args:
      start: a place with its time, or LAT,LON,TIME in UTC; None: the last fix of the logs.
      known: state by the logs; None: there are none, and `start` is needed.

    Raises:
      InputError: the text cannot be read, or the logs are too old or too far away.
    """
    if isinstance(start, Origin):
        latitude, longitude, time = start.latitude_deg, start.longitude_deg, str(start.time)
    elif start is not None:
        place = parse_place(start)
        if "time" not in place:
            raise InputError(f"--from {start}: the time is missing: LAT,LON,TIME in UTC")
        latitude, longitude, time = place["latitude"], place["longitude"], utc_text(place["time"])
    elif known is None or known.place is None or known.time is None:
        raise InputError("give --from LAT,LON,TIME, or --logs to begin at their last fix")
    else:
        latitude, longitude = known.place
        time = utc_text(datetime.datetime.fromtimestamp(round(known.time), datetime.UTC))
    seconds = unix_seconds(time)
    known = known or known_without_logs(latitude, seconds)
    stale = known.check_begin(latitude, longitude, seconds)
    origin = Origin(latitude_deg=latitude, longitude_deg=longitude, time=time)
    return origin, known.at(seconds), stale


def _last_deployment(logs: LogStore) -> tuple[str, str]:
    """Names of the last deployment with a dive from fix to fix (else the last of all), and of the
    last of all if that is another one, else empty."""
    starts = np.where(np.isfinite(logs.starts), logs.starts, -np.inf)
    last = int(np.argmax(starts))
    fixed = np.isfinite(logs.number("displacement_north"))
    best = int(np.argmax(np.where(fixed, starts, -np.inf))) if fixed.any() else last
    names = str(logs.deployments[best]), str(logs.deployments[last])
    return names[0], "" if names[0] == names[1] else names[1]


MOVING = 0.03
"""[m/s] Smallest vertical velocity of a dive: at less, the vehicle hovers or floats"""


def _last_seen(logs: LogStore, deployment: str) -> LastSeen | None:
    """Newest sample of a deployment; None where it has no depth."""
    end, row = max((float(logs.time(row)[-1]), row) for row in logs.missions_of(deployment))
    if "measured_depth" not in logs:
        return None
    depth = np.asarray(logs.signal("measured_depth", row), float)
    if not np.isfinite(depth[-1]):
        return None
    rate = np.abs(np.diff(depth)) / logs.period
    rate = rate[rate > MOVING]
    rise = float(depth[-1] / np.median(rate)) if len(rate) else 0.0
    return LastSeen(time=end, depth=float(depth[-1]), rise=max(rise, 0.0))
