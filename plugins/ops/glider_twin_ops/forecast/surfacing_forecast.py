"""Surfacing forecast: the next surfacings of a glider by flown members, and its boxes for notices.

A notice to authorities names parallels and meridians between which a glider stays for twelve hours.
The edges of such a box are the outermost of all members, rounded outward. One more member would
cross one of the four edges with a probability of 4 / (members + 1) at most.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import datetime
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from glider_twin_ops.forecast.member_flights import (
    HALF,
    NINETY,
    MemberFlight,
    Surfacing,
    coarse_steps,
    degrees,
    fly,
    left_out,
    over,
    surfacings_of,
)
from glider_twin_ops.forecast.members import members_of
from glider_twin_ops.forecast.request import HOUR, Known, Request
from twin.checks import EndsApart, ends_apart, flown_in_mujoco
from twin.errors import SimulationUnstable, TwinError
from twin.geodesy import wrap_longitude
from twin.numbers import Array
from twin.records import unix_seconds
from twin.records.coordinates import utc_clock, utc_minute

DAY = 86400.0
MINUTE, KILO = 60.0, 1e3
KWH = 3.6e6
"""[J]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Forecast:
    """Forecast by the members flown so far; a request's last forecast has all members."""

    request: Request
    surfacings: tuple[Surfacing, ...]
    flown: int
    """Number of members flown so far."""
    failed: int
    """Number of members whose flight became unstable."""
    track: Array
    """Longitude, latitude [degree] of the first member, which has all mean values, (point, 2)."""
    spread: dict[str, str]
    """Sampled quantities and their standard deviations, in words."""
    power_w: float
    """Mean electrical power of the members."""
    ways: tuple[tuple[Array, Array], ...]
    """Track of each member: times [s] after the start, and north, east [m], (point, 2)."""
    left_out: str = ""
    """Reason why a surfacing within the hours is not reported; empty: none is left out."""
    over_s: float | None = None
    """[s] Median time after the start at which the mission ends; None: it continues."""
    beside_mujoco: EndsApart | None = None
    """Difference between lanes and MuJoCo for the first member; None until all are flown."""

    @property
    def complete(self) -> bool:
        """True once all members have been flown."""
        return self.flown + self.failed == self.request.members

    @property
    def remarks(self) -> list[str]:
        """Warnings about a surfacing that is left out and a mission that ends early."""
        said = [self.left_out] if self.left_out else []
        if self.over_s is not None:
            said.append(
                f"the plan is over about {self.minute(self.over_s)} UTC, "
                f"{self.request.hours - self.over_s / HOUR:.1f} h before the forecast ends: from "
                "then on it is taken to float and drift, and boxes and energy are of that. Give "
                "more places in goto, a longer mission, or fewer hours"
            )
        return said

    @property
    def bounds_known(self) -> str:
        """Standard deviation of the bounds of the times, in words; empty without surfacings."""
        if not self.surfacings or self.flown < 2:
            return ""
        off = ", ".join(f"{one.bound_s / MINUTE:.0f}" for one in self.surfacings)
        return (
            f"{self.flown} members tell the bounds of the times to +-{off} min: other members, "
            "hours or seeds move them by as much; more members tell them better"
        )

    @property
    def days_left(self) -> float | None:
        """[d] Time until the batteries are empty at this power; None if their energy is unknown."""
        if self.request.energy_left_kwh is None or self.power_w <= 0.0:
            return None
        return self.request.energy_left_kwh * KWH / self.power_w / DAY

    @property
    def energy_per_day(self) -> str:
        """Energy per day in words, in kJ and in kW h."""
        return f"{self.power_w * DAY / KILO:.0f} kJ ({self.power_w * DAY / KWH:.2f} kWh)"

    @property
    def begins(self) -> datetime.datetime:
        """Time of the start, UTC."""
        return datetime.datetime.fromisoformat(str(self.request.place.time))

    def moment(self, seconds: float) -> str:
        """Time `seconds` after the start, UTC, ISO 8601 to the second."""
        return (self.begins + datetime.timedelta(seconds=round(seconds))).isoformat()

    def minute(self, seconds: float) -> str:
        """Time `seconds` after the start, UTC, for people, such as 2023-09-20 06:31."""
        return utc_minute(unix_seconds(str(self.request.place.time)) + round(seconds))

    def bounds(self, one: Surfacing) -> str:
        """Times, UTC, between which 90 % of the members surface, with the day if it differs."""
        begin = unix_seconds(str(self.request.place.time))
        times = (utc_clock(begin + at, begin + one.time_s) for at in (one.early_s, one.late_s))
        return " to ".join(times)

    def targets(self) -> Array:
        """Longitude, latitude [degree] of the mission's targets, (target, 2)."""
        place = self.request.place
        placed = self.request.mission.placed(place.latitude_deg, place.longitude_deg)
        points = [
            (target["north_m"], target["east_m"])
            for segment in placed.segments
            for target in getattr(segment, "targets", ())
        ]
        return degrees(np.array(points).reshape(-1, 2), place)

    def describe(self) -> dict[str, Any]:
        """Numbers as `--json` prints them."""
        request, place, beside = self.request, self.request.place, self.beside_mujoco
        same = ("flown", "failed", "spread", "left_out", "over_s", "remarks", "bounds_known")
        return {
            "vehicle": request.vehicle.name,
            "mission": request.mission.name,
            "start": {
                "latitude": place.latitude_deg,
                "longitude": place.longitude_deg,
                "time": str(place.time),
            },
            "hours": request.hours,
            "members": request.members,
            "engine": request.engine,
            "beside_mujoco": None if beside is None else dataclasses.asdict(beside),
            **{name: getattr(self, name) for name in same},
            "notes": list(request.notes()),
            "surfacings": [
                one.describe()
                | {k: self.moment(getattr(one, f"{k}_s")) for k in ("time", "early", "late")}
                for one in self.surfacings
            ],
            "power_W": self.power_w,
            "energy_kJ_per_day": self.power_w * DAY / KILO,
            "energy_kWh_per_day": self.power_w * DAY / KWH,
            "days_left": self.days_left,
        }

    def geojson(self) -> dict[str, Any]:
        """GeoJSON FeatureCollection (RFC 7946) of surfacings, ellipses, track and targets."""
        features = [feature("LineString", self.track.tolist(), {"what": "track of the mean"})]
        features += [
            feature("Point", target, {"what": "target", "number": k})
            for k, target in enumerate(self.targets().tolist(), start=1)
        ]
        for one in self.surfacings:
            said = {"number": one.number, "time": self.moment(one.time_s)}
            for part in (NINETY, HALF):
                ring = one.ring(part, self.request.place).tolist()
                said_of_it = {"what": f"ellipse of {100.0 * part:.0f} %", "holds": part, **said}
                features.append(feature("Polygon", [ring], said_of_it))
            point = [one.longitude, one.latitude]
            features.append(feature("Point", point, {"what": "surfacing", **said}))
        return collection(features)


def feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    """GeoJSON feature (RFC 7946)."""
    shape = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": shape, "properties": properties}


def collection(features: list[dict[str, Any]]) -> dict[str, Any]:
    """GeoJSON FeatureCollection."""
    return {"type": "FeatureCollection", "features": features}


def forecast(
    request: Request,
    known: Known,
    *,
    threads: int = 0,
    refined: Callable[[Forecast], object] = lambda found: None,
) -> Forecast:
    """Fly the members and forecast the surfacings.

    Args:
      known: state at the time of the start (`begun`).
      threads: number of threads of the fleets; 0 takes every core.
      refined: called with the forecast so far, after the first member and after each fleet.

    Raises:
      InputError and its subclasses: the request cannot be flown.
      TwinError: the flights of all members became unstable.
    """
    members = members_of(request, known)
    flights: list[MemberFlight] = []
    number = 0
    found: Forecast | None = None
    lanes = request.engine == "lanes"
    with coarse_steps(), concurrent.futures.ThreadPoolExecutor(1) as pool:
        beside = pool.submit(flown_in_mujoco, members.scenarios[0]) if lanes else None  # meanwhile
        nominal: MemberFlight | SimulationUnstable | None = None
        for chunk in fly(members.scenarios, threads=threads):
            nominal = nominal or chunk[0]
            for k, one in enumerate(chunk, start=number):
                if isinstance(one, MemberFlight):
                    flights.append(members.delayed(k, one))
            number += len(chunk)
            if not flights:
                continue
            told = surfacings_of(flights, request.place, request.horizon)
            until = flights[0].times <= request.horizon
            found = Forecast(
                request=request,
                surfacings=told,
                left_out=left_out(flights, len(told), request.horizon),
                over_s=over(flights, request.horizon),
                flown=len(flights),
                failed=number - len(flights),
                track=degrees(flights[0].track[until], request.place),
                spread=members.spread,
                power_w=float(np.mean([one.taken / one.duration for one in flights])),
                ways=tuple((one.times, one.track) for one in flights),
            )
            refined(found)
    if found is None:
        raise TwinError(
            f"none of {request.members} members could be flown to its end: fly the mission with "
            "`twin simulate` to see why"
        )
    if beside is not None and isinstance(nominal, MemberFlight):
        apart = ends_apart(nominal.duration, nominal.end, beside.result())
        found = dataclasses.replace(found, beside_mujoco=apart)
    return found


HOURS = 12.0
MINUTES = 60.0
"""Minutes in a degree"""
TENTH = 10.0
"""Edges are rounded to 1/10 of a minute: 185 m along a meridian"""
MOMENT = "%Y-%m-%d %H:%M"


@dataclasses.dataclass(frozen=True, kw_only=True)
class NoticeBox:
    """Box of one notice, in degrees; across the date line `west` is greater than `east`."""

    begin: datetime.datetime
    """UTC"""
    end: datetime.datetime
    south: float
    north: float
    west: float
    east: float
    holds: float
    """[1] Smallest probability that the whole track lies inside"""

    def text(self) -> str:
        """Text of one line, in degrees and minutes."""
        south, north = (_angle(value, "NS", 2) for value in (self.south, self.north))
        west, east = (_angle(value, "EW", 3) for value in (self.west, self.east))
        return (
            f"{self.begin:{MOMENT}} to {self.end:{MOMENT}} UTC: {south} to {north}, {west} to "
            f"{east}"
        )

    def feature(self) -> dict[str, Any]:
        """GeoJSON feature; longitudes do not wrap at the date line."""
        west, east = self.west, self.east + (360.0 if self.east < self.west else 0.0)
        south, north = self.south, self.north
        ring = [[west, south], [east, south], [east, north], [west, north], [west, south]]
        begin, end = self.begin.isoformat(), self.end.isoformat()
        said = {"what": "box of a notice", "begin": begin, "end": end, "holds": self.holds}
        return feature("Polygon", [ring], said)


def notice_boxes(found: Forecast, hours: float = HOURS) -> list[NoticeBox]:
    """Boxes in order of time, to the horizon or to the median end of the members' flights.

    Args:
      found: forecast of all members. hours: [h] duration of each box.
    """
    ways = [(time, degrees(way, found.request.place)) for time, way in found.ways]
    last = min(found.request.horizon, float(np.median([time[-1] for time, _ in ways])))
    boxes = []
    for begin in np.arange(0.0, last, hours * HOUR):
        end = min(begin + hours * HOUR, last)
        parts = [way[(time > begin) & (time < end)] for time, way in ways]
        parts += [
            np.array([np.interp([begin, end], time, axis) for axis in way.T]).T
            for time, way in ways
        ]
        inside = np.concatenate(parts)
        west, south = np.floor(inside.min(0) * MINUTES * TENTH) / MINUTES / TENTH
        east, north = np.ceil(inside.max(0) * MINUTES * TENTH) / MINUTES / TENTH
        west, east = wrap_longitude(np.array([west, east])).tolist()
        boxes.append(
            NoticeBox(
                begin=found.begins + datetime.timedelta(seconds=begin),
                end=found.begins + datetime.timedelta(seconds=end),
                south=float(south),
                north=float(north),
                west=west,
                east=east,
                holds=max(0.0, 1.0 - 4.0 / (len(ways) + 1)),
            )
        )
    return boxes


def boxes_text(boxes: Sequence[NoticeBox], title: str) -> str:
    """Text of all boxes, for a message."""
    if not boxes:
        return f"{title}: no forecast, so no boxes\n"
    which = "these boxes" if len(boxes) > 1 else "this box"
    lines = [
        f"{title}: an underwater glider stays within {which} with a probability of "
        f"{100.0 * boxes[0].holds:.0f} %"
    ]
    return "\n".join([*lines, *(one.text() for one in boxes)]) + "\n"


def _angle(value: float, signs: str, digits: int) -> str:
    tenths = round(abs(value) * MINUTES * TENTH)
    whole, minutes = divmod(tenths, round(MINUTES * TENTH))
    return f"{whole:0{digits}d}-{minutes / TENTH:04.1f}{signs[value < 0.0]}"
