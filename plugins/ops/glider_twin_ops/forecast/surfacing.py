"""Surfacing: where, when and at which cost members come up for the n-th time, with ellipses."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from glider_twin_ops.forecast.members import MemberFlight
from twin import Origin
from twin.geodesy import from_tangent_plane, wrap_longitude
from twin.navigation import Ellipse, chi_squared, outline
from twin.numbers import Array

HALF, NINETY = 0.5, 0.9
"""Parts that ellipses hold of the surfacings to expect"""
FIX_DEVIATION = 5.0
"""[m] north and east each, of the GPS fix that will be taken"""
TAILS = np.array([0.05, 0.95])
"""Parts of the members that are up before the two bounds of a time"""
LEAST = 0.99
"""Part of the members that must have a surfacing for it to be told: without the late ones, place,
time and ellipse would be those of the early ones"""
ELLIPSE_POINTS = 64
KILO = 1e3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Surfacing:
    """One surfacing; times are after the start."""

    number: int
    """1 is the next"""
    part: float
    """of the members that have it"""
    north: float
    """[m] from the start"""
    east: float
    """[m]"""
    covariance: Array
    """[m2], (2, 2); of members and fix"""
    latitude: float
    """[degree]"""
    longitude: float
    """[degree]"""
    time_s: float
    """mean"""
    early_s: float
    """5 of 100 members are up before"""
    late_s: float
    """5 of 100 members are up later"""
    bound_s: float
    """deviation of these two by the draw of the members: another seed tells them so far off"""
    energy_kj: float
    """mean, taken since the start"""
    energy_deviation_kj: float
    members: Array
    """North, east [m] of every member that has it, (member, 2)"""

    def ellipse(self, holds: float) -> Ellipse:
        """That which holds a part of the surfacings to expect, such as 0.9.

        Of few members it is wider: their mean and covariance are known by them alone.
        """
        return Ellipse.of(self._shape(holds))

    def _shape(self, holds: float) -> Array:
        """[m2], (2, 2): squared semi-axes, from north and east."""
        fix = FIX_DEVIATION**2 * np.eye(2)
        drawn = prediction_quantile(holds, len(self.members))
        return drawn * (self.covariance - fix) + chi_squared(holds) * fix

    def ring(self, holds: float, place: Origin) -> Array:
        """Longitude, latitude [degree] around it, closed, counterclockwise, (point, 2)."""
        around = outline(self._shape(holds), ELLIPSE_POINTS + 1)
        return degrees(np.array([self.north, self.east]) + around, place)

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        return {
            "number": self.number,
            "part_of_members": self.part,
            "latitude": self.latitude,
            "longitude": self.longitude,
            "time_s": self.time_s,
            "early_s": self.early_s,
            "late_s": self.late_s,
            "bound_s": self.bound_s,
            "ellipse_50": dataclasses.asdict(self.ellipse(HALF)),
            "ellipse_90": dataclasses.asdict(self.ellipse(NINETY)),
            "energy_kJ": self.energy_kj,
            "energy_deviation_kJ": self.energy_deviation_kj,
        }


def prediction_quantile(holds: float, count: int) -> float:
    """Squared deviations, in those of `count` draws, within which a further draw falls in a plane.

    (n^2 - 1) p / (n (n - p)) of the quantile of F(p, n - p), p = 2 (Hotelling 1931, Ann. Math.
    Stat. 2); chi-squared's for many draws. Fewer than three tell no more than three do.
    """
    n = max(count, 3)
    return (n * n - 1.0) / n * ((1.0 - holds) ** (-2.0 / (n - 2)) - 1.0)


def surfacings_of(
    flights: Sequence[MemberFlight], place: Origin, within: float = math.inf
) -> tuple[Surfacing, ...]:
    """The surfacings whose median time is within a horizon, in order, while all members have them.

    Args:
      flights: of the members so far, flown beyond the horizon; of a single one the ellipses are
        those of its fix.
      place: of the start. within: [s] the horizon.
    """
    found = []
    for index in range(max((len(one.time) for one in flights), default=0)):
        having = [one for one in flights if len(one.time) > index]
        if not _due(flights, index, within) or len(having) < LEAST * len(flights):
            break
        places = np.array([one.place[index] for one in having])
        times = np.array([one.time[index] for one in having])
        energy = np.array([one.energy[index] for one in having]) / KILO
        centre = places.mean(axis=0)
        spread = FIX_DEVIATION**2 * np.eye(2)
        if len(having) > 1:
            spread = spread + np.cov(places, rowvar=False)
        longitude, latitude = degrees(centre[None], place)[0]
        early, late = np.quantile(times, TAILS)
        found.append(
            Surfacing(
                number=index + 1,
                part=len(having) / len(flights),
                north=float(centre[0]),
                east=float(centre[1]),
                covariance=spread,
                latitude=float(latitude),
                longitude=float(wrap_longitude(longitude)),
                time_s=float(times.mean()),
                early_s=float(early),
                late_s=float(late),
                bound_s=_bound_deviation(times),
                energy_kj=float(energy.mean()),
                energy_deviation_kj=float(energy.std()),
                members=places,
            )
        )
    return tuple(found)


def _bound_deviation(times: Array) -> float:
    """[s] Standard deviation of the two bounds of times by the draw of the members, their mean.

    How many of n members are before a bound is binomial: half of the distance between the ranks one
    deviation before and behind it (David and Nagaraja 2003, Order Statistics, section 7.1).
    """
    off = np.sqrt(TAILS * (1.0 - TAILS) / len(times))
    below, above = (np.quantile(times, np.clip(TAILS + s * off, 0.0, 1.0)) for s in (-1.0, 1.0))
    return 0.5 * float((above - below).mean())


def left_out(flights: Sequence[MemberFlight], told: int, within: float) -> str:
    """Why the surfacing after those told is not told; empty where none is due."""
    if not _due(flights, told, within):
        return ""
    part = sum(len(one.time) > told for one in flights) / len(flights)
    return (
        f"surfacing {told + 1} is left out: only {100.0 * part:.0f} % of the members have it, the "
        "others end at their last target or are late; their mean would be that of the early ones"
    )


def over(flights: Sequence[MemberFlight], within: float) -> float | None:
    """[s] at which the mission is over in the median, where half of the members end it by a time
    [s] that a forecast reaches to; else None."""
    ends = [float(one.time[-1]) for one in flights if one.over and one.time[-1] < within]
    return float(np.median(ends)) if 2 * len(ends) >= max(len(flights), 1) else None


def _due(flights: Sequence[MemberFlight], index: int, within: float) -> bool:
    """Whether half of the members have a surfacing within a time [s]."""
    early = sum(len(one.time) > index and one.time[index] <= within for one in flights)
    return 2 * early >= max(len(flights), 1)


def degrees(points: Array, place: Origin) -> Array:
    """Longitude, latitude [degree] of north, east [m] from a place, (point, 2).

    Longitudes go on across the date line.
    """
    latitude, longitude = from_tangent_plane(
        points[:, 0], points[:, 1], place.latitude_deg, place.longitude_deg
    )
    return np.stack([longitude, latitude], axis=1)
