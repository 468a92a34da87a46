"""Samples: one mission of a store as topics are made of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factory.generation.generated_store import GeneratedStore, StoredFlight
from twin.errors import StoreError
from twin.geodesy import from_tangent_plane, offset, position
from twin.records.coordinates import (
    DATETIME,
    LATITUDE,
    LONGITUDE,
    START_LATITUDE,
    START_LONGITUDE,
    read_place,
)
from twin.records.reader import MissionStore
from twin.records.schema import MISSION
from twin.records.timeseries import FIXES, sample_coordinates
from twin.sensors.imu import Imu

Array = NDArray[np.float64]

NANOSECONDS = 1_000_000
"""In a millisecond"""


class McapSamples:
    """Signals, moments and places of a mission, the `twin.serve.ros_topics.Samples` of a store.

    Raises:
      StoreError: it is damaged, or does not say when the mission began.
    """

    def __init__(self, run: MissionStore, mission: int, origin: tuple[float, float] | None) -> None:
        """Read the moments; signals are read when they are asked for.

        Args:
          origin: latitude and longitude [degree] of the frame `map`; None: the mission's start.
        """
        self.run, self.mission = run, mission
        self.count = int(run.samples[mission])
        self.names = run.signals()
        self.logged, self.period = run.logged, run.period
        self.imu_position = run.vehicle.imu_position
        self.gps_deviation: float | None = None
        if isinstance(run, GeneratedStore):
            self.gps_deviation = run.sensor_constants(mission).get("gps_sigma") or None
        imu = run.suite.get("imu") if isinstance(run, GeneratedStore | StoredFlight) else None
        self.imu = imu if isinstance(imu, Imu) else None
        where = sample_coordinates(run, mission)
        moments = where[DATETIME].astype("datetime64[ms]")
        if np.isnat(moments).any():
            raise StoreError(
                f"store {run.path} lacks the start time of mission {mission}, and messages have "
                "dates: make it again with a start time"
            )
        self.time: NDArray[np.int64] = moments.astype(np.int64) * NANOSECONDS
        """[ns] unix time of each sample"""
        self.latitude, self.longitude = where[LATITUDE], where[LONGITUDE]
        self.place = read_place(run.dataset.isel({MISSION: mission}))
        start = (self.place.get(START_LATITUDE, np.nan), self.place.get(START_LONGITUDE, np.nan))
        self.start = float(start[0]), float(start[1])
        self.origin = self.start if origin is None else origin
        self._read: dict[str, Array] = {}

    def signal(self, name: str) -> Array:
        """A signal as the store has it, (samples,)."""
        if name not in self._read:
            row = self.run.row(name, self.mission)[: self.count]
            self._read[name] = row.astype(float)
        return self._read[name]

    def track(self) -> tuple[Array, Array]:
        """North and east [m] from the origin of `map` of the places that the store holds.

        For logs, metres along the meridian and the parallel, as everywhere with them.
        """
        return offset(self.latitude, self.longitude, *self.origin)

    def fixes(self) -> tuple[Array, Array]:
        """Latitude and longitude [degree] of the GPS fixes, (samples,); NaN without one."""
        degrees = position if self.run.logged else from_tangent_plane
        north, east = (self.signal(name) for name in FIXES)
        return degrees(north, east, *self.start)
