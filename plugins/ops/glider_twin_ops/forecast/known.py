"""Known: what is known of the water and of the vehicle's way before a forecast begins.

A pool of models of the current holds it, one of them a current filter: without logs the filter's
prior (mean current, eddies, tide, inertial oscillation, speed and compass, as
`twin.navigation.current.CurrentParameters` has them), with logs what the fixes of their last
deployment have told the models, and what each was worth.
"""

from __future__ import annotations

import dataclasses
import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from glider_twin_ops.forecast.expected_dive import Rhythm, WayPool
from glider_twin_ops.forecast.logged_leg import (
    MODEL,
    dive_times,
    flown_velocities,
    legs_of,
    place_at,
    why_no_legs,
)
from glider_twin_ops.forecast.pool import FILTER, CurrentPool
from glider_twin_ops.forecast.walk import walk
from twin import Origin
from twin.cli import counted
from twin.errors import InputError, StoreError
from twin.geodesy import great_circle
from twin.navigation import chi_squared
from twin.navigation.current import CurrentFilter
from twin.physics import parse_place, utc_text
from twin.records import LogStore, unix_seconds
from twin.records.coordinates import utc_minute

DAY, KILO = 86400.0, 1e3
OLD, FAR = 2.0, 30.0
"""[d], [km] beyond which logs are warned of: eddies and tides decorrelate over these"""
MOST_DAYS, MOST_AWAY, MOST_PER_DAY = 30.0, 100.0, 100.0
"""[d], [km], [km/d] beyond which they are refused: more than a glider drifts at 1.2 m/s"""
MOST_BEFORE = 60.0
"""[s] by which clocks may differ"""


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
    """The state at the last fix."""

    pool: CurrentPool
    """At the time of the last fix, on the clock of unix seconds."""
    place: tuple[float, float] | None = None
    """Latitude, longitude [degree] of the last fix; None without logs."""
    time: float | None = None
    """[s] unix of the last fix; None without logs."""
    last_current: tuple[float, float] | None = None
    """North, east [m/s], mean over the last dive: what the vehicle itself believes."""
    source: str = "no logs"
    """In words."""
    legs: int = 0
    """Dives that told it."""
    ways: WayPool | None = None
    """How the vehicle went beside how it was sent; None without logs."""
    reach: float = chi_squared(0.9)
    """[1] squared distance within which nine of ten surfacings of the log were of what would have
    been forecast for them."""
    rhythm: Rhythm | None = None
    """How long it stays at the surface and how its dives keep the time; None: not known."""
    silent: str = ""
    """What the log does not tell of its dives, in words; empty where nothing is missing"""
    last_seen: LastSeen | None = None
    """The newest sample of the log, where it is newer than the last fix."""
    by_model: bool = False
    """Whether the way through the water was the vehicle's flight model's: the filter's errors of
    speed and compass are then the model's."""

    @property
    def filter_(self) -> CurrentFilter:
        """The pool's current filter: it alone knows the errors of speed and compass, too."""
        return self.pool.filters[FILTER]

    def at(self, time: float) -> Known:
        """The same later, at a unix time [s]: what was known of the current has aged.

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
        """Whether the logs tell anything of a place [degree] and a unix time [s]; else why not.

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
        last_current=(float(last.leg.current[0]), float(last.leg.current[1])),
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


def begun(start: str | None, known: Known | None) -> tuple[Origin, Known, str]:
    """Where and when a forecast begins, what is known then, and a warning where that is little.

    Args:
      start: LAT,LON,TIME in UTC; None: the last fix of the logs.
      known: by the logs; None: there are none, and `start` is needed.

    Raises:
      InputError: the text cannot be read, or the logs tell nothing of that place and time.
    """
    if start is not None:
        place = parse_place(start)
        if "time" not in place:
            raise InputError(f"--from {start}: the time is missing: LAT,LON,TIME in UTC")
        time = utc_text(place["time"])
        latitude, longitude = place["latitude"], place["longitude"]
    else:
        if known is None or known.place is None or known.time is None:
            raise InputError("give --from LAT,LON,TIME, or --logs to begin at their last fix")
        latitude, longitude = known.place
        time = utc_text(datetime.datetime.fromtimestamp(round(known.time), datetime.UTC))
    if known is None:
        known = known_without_logs(latitude, unix_seconds(time))
    stale = known.check_begin(latitude, longitude, unix_seconds(time))
    origin = Origin(latitude_deg=latitude, longitude_deg=longitude, time=time)
    return origin, known.at(unix_seconds(time)), stale


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
    moving = rate[rate > MOVING]
    rise = float(depth[-1] / np.median(moving)) if len(moving) else 0.0
    return LastSeen(time=end, depth=float(depth[-1]), rise=max(rise, 0.0))
