"""Place: where on Earth the metres of a mission's frame are."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.geodesy import from_tangent_plane, position, wrap_longitude
from twin.records.logs import numbers
from twin.records.place import START_LATITUDE, START_LONGITUDE
from twin.records.reader import MissionStore

Array = NDArray[np.float64]


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
