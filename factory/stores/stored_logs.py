"""Stored logs: a store of `factory import` read back, dive by dive, with real time and place."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.stores.stored import Stored, StoredRun, is_log
from factory.stores.stored_flight import StoredFlight, is_flight
from twin.errors import StoreError
from twin.geodesy import position
from twin.records.store import IMPORT_REPORT, open_store
from twin.water.current.origin import HIGHEST_LATITUDE

Array = NDArray[np.float64]

NANOSECONDS = 1e9
CURRENTS = (("vehicle_dac_north", "vehicle_dac_east"), ("dac_north", "dac_east"))
"""Depth-averaged currents that a store may have, the better ones first: as the vehicle or its
basestation reported them, from a flight model, or the import's, from depth rate and pitch."""


class StoredLogs(Stored):
    """A store of logs; its missions are dives.

    Raises:
      StoreError: missing, damaged, of a newer schema, or no store of logs.
    """

    def __init__(self, path: str | Path):
        super().__init__(path)
        try:
            self.report: dict[str, Any] = json.loads(self.dataset.attrs[IMPORT_REPORT])
            self.kind, self.platform = str(self.report["kind"]), str(self.dataset.attrs["platform"])
            self.simulated = "simulated" in str(self.dataset.attrs["comment"])
        except (KeyError, ValueError) as error:
            raise StoreError(
                f"store {self.path} was not made by `factory import`, or its attributes are "
                f"damaged ({type(error).__name__}: {error})"
            ) from error

    @functools.cached_property
    def deployments(self) -> list[str]:
        """Name of each dive's deployment."""
        return [str(name) for name in self.small("deployment")]

    @functools.cached_property
    def starts(self) -> Array:
        """Unix time [s] of each dive's first sample."""
        values = self.small("start_time")
        if np.issubdtype(values.dtype, np.datetime64):
            values = values.astype("datetime64[ns]").astype(np.int64) / NANOSECONDS
        return np.asarray(values, float)

    def number(self, name: str) -> Array:
        """A number of each dive; NaN where the store has no such array."""
        if name not in self.dataset:
            return np.full(len(self), np.nan)
        return np.asarray(self.small(name), float)

    @functools.cached_property
    def hours(self) -> float:
        """Logged time of all dives [h]."""
        return float(self.samples.sum()) * self.period / 3600.0

    def missions_of(self, deployment: str) -> list[int]:
        """Dives of a deployment, in order of time."""
        chosen = [k for k, name in enumerate(self.deployments) if name == deployment]
        return sorted(chosen, key=lambda k: self.starts[k])

    def time(self, mission: int) -> Array:
        """Unix time [s] of each sample of a dive."""
        return np.asarray(self.starts[mission] + self.period * np.arange(self.samples[mission]))

    def signal(self, name: str, mission: int) -> Array:
        """A signal of a dive without padding; NaN where the store has no such signal."""
        count = int(self.samples[mission])
        if name not in self.dataset:
            return np.full(count, np.nan)
        return self.row(name, mission)[:count].astype(float)

    def fixes(self, mission: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """Latitude and longitude [degree] at the start and at the end of a dive; NaN without."""
        names = ("start_latitude", "start_longitude", "end_latitude", "end_longitude")
        a, b, c, d = (float(self.number(name)[mission]) for name in names)
        return (a, b), (c, d)

    def current(self, mission: int) -> tuple[float, float]:
        """Depth-averaged current [m/s] of a dive, north and east; NaN when the store has none."""
        for names in CURRENTS:
            north, east = (float(self.number(name)[mission]) for name in names)
            if np.isfinite(north) and np.isfinite(east):
                return north, east
        return np.nan, np.nan

    def positions(self, mission: int) -> tuple[Array, Array, str]:
        """Latitude and longitude [degree] of a dive's samples, and how they were found.

        The vehicle's own track where it logged one, else a straight line in time between the two
        fixes; NaN where neither is known.
        """
        start, end = self.fixes(mission)
        count = int(self.samples[mission])
        if not np.isfinite(start).all():
            return np.full(count, np.nan), np.full(count, np.nan), "unknown"
        north, east = (self.signal(f"measured_onboard_{n}", mission) for n in ("north", "east"))
        if np.isfinite(north).any() and abs(start[0]) <= HIGHEST_LATITUDE:
            return *position(north, east, *start), "on-board track"
        if not np.isfinite(end).all():
            return np.full(count, np.nan), np.full(count, np.nan), "unknown"
        share = np.linspace(0.0, 1.0, count)
        turn = (end[1] - start[1] + 180.0) % 360.0 - 180.0
        latitude = start[0] + share * (end[0] - start[0])
        return latitude, start[1] + share * turn, "straight line between GPS fixes"


def open_exportable(path: str | Path) -> Stored:
    """As `open_stored`, and also a single flight of `twin simulate` with sensors.

    Raises:
      StoreError: it cannot be read, is none of these, or was flown without sensors.
    """
    flight = is_flight(open_store(path).attrs)
    return StoredFlight(path) if flight else open_stored(path)


def open_stored(path: str | Path) -> StoredRun | StoredLogs:
    """The store as what it is: flown by the factory, or logged at sea.

    Raises:
      StoreError: it cannot be read, or is neither.
    """
    return StoredLogs(path) if is_log(open_store(path)) else StoredRun(path)
