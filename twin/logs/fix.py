"""Fixes: where and when GPS said that a vehicle was, within one mission of a store.

Place: where on Earth the metres of a mission's frame are.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.geodesy import from_tangent_plane, position, wrap_longitude
from twin.records.coordinates import START_LATITUDE, START_LONGITUDE
from twin.records.logged import numbers
from twin.records.reader import MissionStore

Array = NDArray[np.float64]

GPS_DEVIATION = 5.0
"""[m] standard deviation, north and east each, of a receiver whose antenna is in the waves."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fixes:
    """The fixes of a mission, in order of time."""

    sample: NDArray[np.intp]
    """Index of the sample at which each was taken, (fix,), increasing."""
    position: Array
    """North, east [m] from the mission's origin, (fix, 2)."""
    deviation: float = GPS_DEVIATION
    """[m] north and east each"""

    def __len__(self) -> int:
        return len(self.sample)


def fixes_of(store: MissionStore, mission: int) -> Fixes:
    """The fixes of a mission of a store; none where it has no GPS.

    A simulated mission was launched at its origin: that place is known as a fix is, whether the
    receiver had one by then or not.
    """
    names = ("measured_gps_north", "measured_gps_east")
    if any(name not in store for name in names):
        return Fixes(sample=np.zeros(0, np.intp), position=np.zeros((0, 2)))
    count = int(store.samples[mission])
    found = np.stack([store.row(name, mission)[:count].astype(float) for name in names], axis=1)
    if not store.logged and not np.isfinite(found[0]).all():
        found[0] = 0.0
    return fixes_at(found)


def fixes_at(known: Array) -> Fixes:
    """The fixes in positions [m], (time, 2), that are NaN where there is none."""
    sample = np.flatnonzero(np.isfinite(known).all(axis=1))
    return Fixes(sample=sample, position=known[sample])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Place:
    """The origin of a mission's frame [degree], NaN where the store does not say."""

    latitude: float
    longitude: float
    logged: bool
    """Logs count metres along the meridian and the mean parallel, simulated missions fly in the
    plane that touches at the origin (`twin.geodesy`)."""

    @property
    def known(self) -> bool:
        """Whether it is."""
        return bool(np.isfinite(self.latitude) and np.isfinite(self.longitude))

    def degrees(self, north: Array, east: Array) -> tuple[Array, Array]:
        """Latitude and longitude [degree] of points [m] of the frame; NaN without an origin."""
        if not self.known:
            return np.full_like(north, np.nan), np.full_like(east, np.nan)
        convert = position if self.logged else from_tangent_plane
        latitude, longitude = convert(north, east, self.latitude, self.longitude)
        return latitude, wrap_longitude(longitude)


def place_of(store: MissionStore, mission: int) -> Place:
    """The place of one mission of a store."""
    return places_of(store, [mission])[mission]


def places_of(store: MissionStore, missions: Sequence[int]) -> dict[int, Place]:
    """The places of these missions of a store."""
    latitude, longitude = (numbers(store, n) for n in (START_LATITUDE, START_LONGITUDE))
    make = functools.partial(Place, logged=store.logged)
    return {
        mission: make(latitude=float(latitude[mission]), longitude=float(longitude[mission]))
        for mission in missions
    }
