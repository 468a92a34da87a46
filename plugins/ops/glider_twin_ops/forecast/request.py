"""Request: what a forecast is asked for, checked before anything is flown, and what is then known.

A pool of models of the current holds what is known of the water, one of them a current filter:
without logs the filter's prior (mean current, eddies, tide, inertial oscillation, speed and
compass, as `twin.navigation.current.CurrentParameters` has them), with logs what the fixes of their
last deployment have told the models, and what each was worth.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from glider_twin_ops.forecast.expected_dive import Rhythm, WayPool
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
from twin.navigation import chi_squared
from twin.navigation.current import CurrentFilter
from twin.physics import ENGINES, parse_place, utc_text
from twin.records import LogStore, unix_seconds
from twin.records.coordinates import utc_minute
from twin.water.current import Current

HOUR, DAY = 3600.0, 86400.0
FIELD_ERROR = 0.1
"""[m/s] of a forecast field's depth-averaged current, north and east each: of the size that models
of shelf seas have against gliders"""
LONGEST_HOURS, LEAST_MEMBERS, MOST_MEMBERS = 240.0, 10, 100_000
FASTEST, SLOWEST = 3.0, 0.1
"""[m/s] over ground: a glider's speed and 2 m/s of current, rounded up; and of a climb, for how far
beyond the horizon members fly"""
DEEPEST = 1500.0
"""[m] for a vehicle whose file has no rated depth: that of the deepest among the shipped ones"""
LATE = 0.25
"""Of a dive, by which members come up later than others"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Request:
    """Where from, on what mission, in which water, how many members."""

    vehicle: Vehicle
    mission: Mission
    place: Origin
    """With its time."""
    hours: float = 12.0
    """How far ahead [h]."""
    members: int = 200
    field: Current | None = None
    """A forecast of the current; None: what the logs told goes on."""
    field_error: float = FIELD_ERROR
    """[m/s] standard deviation of its error, north and east each."""
    density: str = "usual"
    """Water column, as `twin simulate --density` takes it."""
    energy_left_kwh: float | None = None
    """Energy left in the batteries [kW h]; None: no days left are told."""
    seed: int = 0
    engine: str = "lanes"
    """What flies the members, as `Scenario.engine`."""

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
        self.notes()  # refuses targets that are too far

    def notes(self) -> tuple[str, ...]:
        """What is odd about depth and targets; MissionError where one is too far to be meant."""
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
        rated, deepest = self.vehicle.rated_depth, self.deepest
        if deepest > (rated or DEEPEST):
            known = (
                f"{self.vehicle.name} is built for {rated:g} m"
                if rated
                else f"no vehicle that is known here is built for more than {DEEPEST:g} m; yours "
                'has it as <numeric name="rated_depth" data="METRES"/> in its file'
            )
            said.append(
                f"dives to {deepest:g} m, and {known}: the forecast flies them though nothing may "
                "come up from there; give a depth that it is built for"
            )
        return tuple(said)

    @property
    def deepest(self) -> float:
        """[m] of all dives of the mission."""
        return max(getattr(one, "max_depth_m", 0.0) for one in self.mission.segments)

    @property
    def horizon(self) -> float:
        """[s] within which surfacings are told."""
        return HOUR * self.hours

    @property
    def flown(self) -> float:
        """[s] that members fly: beyond the horizon, until those that are late are up, too."""
        return self.horizon + self.deepest / SLOWEST + LATE * longest_dive(self.mission)


def check_members(members: int, engine: str = "lanes") -> None:
    """Raise InputError for an unknown engine, and for members that are too few or too many."""
    if engine not in ENGINES:
        raise InputError(unknown_name("engine", str(engine), ENGINES))
    if not LEAST_MEMBERS <= members <= MOST_MEMBERS:
        raise InputError(
            f"forecast: members = {members} must be from {LEAST_MEMBERS} to {MOST_MEMBERS}: fewer "
            "say nothing of an ellipse"
        )


def check_hours(hours: float) -> None:
    """Raise InputError for a forecast that reaches nowhere, or too far ahead."""
    if not 0.0 < hours <= LONGEST_HOURS:
        raise InputError(f"forecast: hours = {hours:g} must be above 0, at most {LONGEST_HOURS:g}")


def mission_to(
    goto: str, *, depth: float, pitch_deg: float, surface_after_s: float, radius: float
) -> Mission:
    """A mission to places in the text "LAT,LON[;LAT,LON ...]".

    Raises:
      MissionError: a place that cannot be read, or an impossible depth or pitch.
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
    """[s] between surfacings that a mission asks for; 3 h where it does not say."""
    times = [getattr(segment, "surface_after_s", None) for segment in mission.segments]
    return max((time for time in times if time is not None), default=3.0 * HOUR)


KILO = 1e3
OLD, FAR, MOST_BEFORE = 2.0, 30.0, 60.0
"""[d], [km] beyond which logs are warned of: eddies and tides decorrelate over these; and [s] by
which clocks may differ"""
MOST_DAYS, MOST_AWAY, MOST_PER_DAY = 30.0, 100.0, 100.0
"""[d], [km], [km/d] beyond which they are refused: more than a glider drifts at 1.2 m/s"""


class LastSeen(NamedTuple):
    """The newest sample of a log: no surfacing to come is earlier."""

    time: float
    """[s] unix"""
    depth: float
    """[m]"""
    rise: float
    """[s] to come up from there as fast as it moved up and down before."""

    @property
    def words(self) -> str:
        """In words."""
        return (
            f"the log has it at {self.depth:.0f} m at {utc_minute(self.time)} UTC: it comes up "
            f"{self.rise / 60.0:.0f} min later at the earliest"
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Known:
    """The state at the last fix; None and empty without logs."""

    pool: CurrentPool
    """At the time of the last fix, on the clock of unix seconds."""
    place: tuple[float, float] | None = None
    """Latitude, longitude [degree] of the last fix."""
    time: float | None = None
    """[s] unix of the last fix."""
    last_current: tuple[float, float] | None = None
    """North, east [m/s], mean over the last dive: what the vehicle itself believes."""
    source: str = "no logs"
    """In words."""
    legs: int = 0
    """Dives that told it."""
    ways: WayPool | None = None
    """How the vehicle went beside how it was sent."""
    reach: float = chi_squared(0.9)
    """[1] squared distance within which nine of ten surfacings of the log were of what would have
    been forecast for them."""
    rhythm: Rhythm | None = None
    """How long it stays at the surface and how its dives keep the time; None: not known."""
    silent: str = ""
    """What the log does not tell of its dives, in words; empty where nothing is missing"""
    last_seen: LastSeen | None = None
    """The newest sample of the log, where it is newer than the last fix"""
    by_model: bool = False
    """Whether the way through the water was the vehicle's flight model's: the filter's errors of
    speed and compass are then the model's."""

    @property
    def filter_(self) -> CurrentFilter:
        """The pool's current filter: it alone knows the errors of speed and compass, too."""
        return self.pool.filters[FILTER]

    def at(self, time: float) -> Known:
        """Age the knowledge of the current to a unix time [s].

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
        """Check that the logs are near enough to a place [degree] and a unix time [s].

        Returns:
          A warning where they are old or from elsewhere; empty where not.

        Raises:
          InputError: they are too old, or from farther away than a glider goes meanwhile.
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
    """Know the prior alone, at a latitude [degree] and a unix time [s]."""
    return Known(pool=CurrentPool(latitude=latitude, time=time))


def known_from_logs(path: str | Path, vehicle: str | None = None) -> Known:
    """Learn what a store of logs tells, by the last deployment that has a dive from fix to fix.

    Args:
      path: of a store that `factory import` wrote.
      vehicle: flight model for the way through the water, a file or a shipped name; None: depth
        rate and pitch, or the vehicle's reported current.

    Raises:
      StoreError: no store of logs, or none of its dives has two fixes and a known way.
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
        ways=walked.ways,
        reach=walked.reach[1],
        rhythm=walked.rhythm,
        silent=times.silent,
        last_seen=seen if seen is not None and seen.time > last.leg.end else None,
        by_model=vehicle is not None and all(one.method == MODEL for one in legs),
    )


def aim_of(path: str | Path) -> str:
    """The place "LAT,LON" that the vehicle was sent to in the last dive of a store of logs, if the
    log has it; else empty.

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
    """Place and time at which a forecast begins, the knowledge then, and a warning if it is poor.

    Args:
      start: a place with its time, or LAT,LON,TIME in UTC; None: the last fix of the logs.
      known: by the logs; None: there are none, and `start` is needed.

    Raises:
      InputError: the text cannot be read, or the logs tell nothing of that place and time.
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
    """The deployment that was at sea last and has a dive from fix to fix, if any has one; and the
    one that was at sea after it, empty if none was."""
    starts = np.where(np.isfinite(logs.starts), logs.starts, -np.inf)
    last = int(np.argmax(starts))
    fixed = np.isfinite(logs.number("displacement_north"))
    best = int(np.argmax(np.where(fixed, starts, -np.inf))) if fixed.any() else last
    names = str(logs.deployments[best]), str(logs.deployments[last])
    return names[0], "" if names[0] == names[1] else names[1]


MOVING = 0.03
"""[m/s] A vehicle that sinks and rises slower hangs, or lies at the surface"""


def _last_seen(logs: LogStore, deployment: str) -> LastSeen | None:
    """Newest sample of a deployment; None where its newest dive has no depth."""
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
