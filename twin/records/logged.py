"""Logged dives: read stores of real vehicles' logs, with UTC times and positions.

A row of a store of logs is one dive, between two GPS fixes if the log has fixes.

`LoggedTrajectory` holds dives as a trajectory, with estimates in place of a simulation's truth.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np

from twin.errors import InputError, StoreError
from twin.geodesy import position, wrap_longitude
from twin.numbers import Array
from twin.records.attributes import (
    DEPLOYMENT,
    DIVE_DURATION,
    FILES,
    IMPORT_REPORT,
    PLATFORM,
    START_TIME,
    SUSPECT,
    says_simulated,
)
from twin.records.coordinates import (
    LATITUDE,
    LONGITUDE,
    METHOD,
    METHODS,
    START_LATITUDE,
    START_LONGITUDE,
)
from twin.records.reader import MissionStore
from twin.records.schema import VARIABLES
from twin.records.storage.store_path import StorePath
from twin.records.trajectory import Trajectory, actuator_names, cumulative
from twin.water.current.axes import HIGHEST_LATITUDE

NANOSECONDS = 1e9
FOLLOWS_WITHIN = 3600.0
"""[s] Longest time between two dives that count as consecutive, with similar currents"""
THRUSTER_FRACTION = "thruster_fraction"
"""Array with the fraction of each dive's time with a thruster on, in logs that record it"""
DRIVEN = 0.01
"""[1] Fraction of time with a thruster on, above which a dive is propelled and no glide"""
CELLS = {
    "cell_ahead": {"units": "m s-1", "long_name": "level velocity past a cell's water, ahead"},
    "cell_starboard": {"units": "m s-1", "long_name": "the same, to starboard"},
    "cell_below": {"units": "m", "long_name": "depth of a cell's middle below the hull"},
}
"""CF attributes of the arrays of a Doppler log's cells, (mission, time, cell)"""
OVERLAP = 1.0
"""[s] Longest apparent overlap of two consecutive dives, from the rounding of times"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogRow:
    """Dive of a log: its times, displacement and propulsion."""

    deployment: str
    start: float
    """[s] Unix time of the dive's first sample; NaN if unknown"""
    duration: float
    """[s] Time from start to end of the dive; NaN if unknown"""
    displacement: tuple[float, float] | None
    """[m] North, east over ground between the dive's fixes; None unless both fixes are known"""
    driven: float = 0.0
    """[1] Fraction of the dive's time with a thruster on"""

    @property
    def powered(self) -> bool:
        """True if a thruster propelled the dive, so that its sink rate is not that of a glide."""
        return self.driven > DRIVEN

    def follows(self, before: LogRow) -> bool:
        """Return whether this dive starts shortly after `before` ends, in the same deployment."""
        gap = self.start - (before.start + before.duration)
        return self.deployment == before.deployment and -OVERLAP <= gap < FOLLOWS_WITHIN


def log_rows(store: MissionStore) -> list[LogRow]:
    """Read a LogRow for each mission of a store; simulated stores have NaN and None in the rows."""
    count = len(store)
    deployments = store.array(DEPLOYMENT) if DEPLOYMENT in store else [""] * count
    starts, durations = start_times(store), numbers(store, DIVE_DURATION)
    driven = np.nan_to_num(numbers(store, THRUSTER_FRACTION))
    moved = (numbers(store, f"displacement_{name}").tolist() for name in ("north", "east"))
    return [
        LogRow(
            deployment=str(deployments[k]),
            start=float(starts[k]),
            duration=float(durations[k]),
            displacement=between if np.isfinite(between).all() else None,
            driven=float(driven[k]),
        )
        for k, between in enumerate(zip(*moved, strict=True))
    ]


def numbers(store: MissionStore, name: str) -> Array:
    """Read an array of numbers, (mission,); NaN if the store lacks the array."""
    if name not in store:
        return np.full(len(store), np.nan)
    return np.asarray(store.array(name), float)


def start_times(store: MissionStore) -> Array:
    """Read the unix time [s] of each mission's first sample, (mission,); NaN if unknown."""
    if START_TIME not in store:
        return np.full(len(store), np.nan)
    values = store.array(START_TIME)
    if np.issubdtype(values.dtype, np.datetime64):
        values = values.astype("datetime64[ns]").astype(np.int64) / NANOSECONDS
    return np.asarray(values, float)


class LogStore(MissionStore):
    """Store of logs, whose missions are dives.

    Raises:
      StoreError: missing, damaged, of a newer schema, or no store of logs.
    """

    def __init__(self, path: str | StorePath):
        super().__init__(path)
        if not self.logged:
            raise StoreError(
                f"store {path} holds simulated missions; this needs logs of real vehicles, as "
                "`factory import` stores them"
            )
        for name in (DEPLOYMENT, START_TIME):
            if name not in self.dataset.variables:
                raise StoreError(f"store {path} of logs has no array {name}; import the logs again")
        self.report: dict[str, Any] = self.json(IMPORT_REPORT)

    @property
    def source(self) -> str:
        """Format of the logs: slocum, seaglider, seaexplorer ..."""
        return str(self.report["kind"])

    @property
    def platform(self) -> str:
        """Names of the vehicles."""
        return str(self.attributes.get(PLATFORM, "unknown"))

    @property
    def files(self) -> str:
        """Names of the imported files, separated by spaces; empty if unknown."""
        return str(self.attributes.get(FILES, ""))

    @property
    def simulated(self) -> bool:
        """True if the store's comment says that a simulation made the logs."""
        return says_simulated(self.attributes)

    @functools.cached_property
    def log_rows(self) -> list[LogRow]:
        """Start, duration and displacement of each dive."""
        return log_rows(self)

    @functools.cached_property
    def deployments(self) -> list[str]:
        """Name of each dive's deployment."""
        return [str(name) for name in self.array(DEPLOYMENT)]

    @functools.cached_property
    def suspect(self) -> list[str]:
        """Reason why each dive's values are impossible; empty for a sound dive."""
        return [str(why) for why in self.array(SUSPECT)] if SUSPECT in self else [""] * len(self)

    @functools.cached_property
    def starts(self) -> Array:
        """[s] Unix time of each dive's first sample."""
        return start_times(self)

    def number(self, name: str) -> Array:
        """Read an array of numbers, (dive,); NaN if the store lacks the array."""
        return numbers(self, name)

    @functools.cached_property
    def hours(self) -> float:
        """[h] Logged time of all dives."""
        return float(self.samples.sum()) * self.period / 3600.0

    def missions_of(self, deployment: str) -> list[int]:
        """Numbers of a deployment's dives, in order of time."""
        chosen = [k for k, name in enumerate(self.deployments) if name == deployment]
        return sorted(chosen, key=lambda k: self.starts[k])

    def time(self, mission: int) -> Array:
        """Unix time [s] of each sample of a dive, (samples,)."""
        return np.asarray(self.starts[mission] + self.period * np.arange(self.samples[mission]))

    def signal(self, name: str, mission: int) -> Array:
        """Read a signal of a dive without padding, (samples,); NaN if the store lacks it."""
        count = int(self.samples[mission])
        if name not in self:
            return np.full(count, np.nan)
        return self.row(name, mission)[:count].astype(float)

    def fixes(self, mission: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """Latitude, longitude [degree] of the fixes at start and end of a dive; NaN without fix."""
        a, b, c, d = (float(value) for value in self._fix_positions[mission])
        return (a, b), (c, d)

    @functools.cached_property
    def _fix_positions(self) -> Array:
        """Latitude and longitude [degree] of the fixes before and after each dive, (dive, 4)."""
        names = ("start_latitude", "start_longitude", "end_latitude", "end_longitude")
        return np.stack([self.number(name) for name in names], axis=1)

    def positions(self, mission: int) -> tuple[Array, Array, str]:
        """Latitude and longitude [degree] of a dive's samples, and the method that gave them.

        Stores of earlier versions hold no positions. There the vehicle's own track gives them, or,
        without a track, a straight line in time between the two fixes. Without track and fixes,
        positions are NaN.
        """
        count = int(self.samples[mission])
        if LATITUDE in self:
            latitude, longitude = (
                self.row(name, mission)[:count].astype(float) for name in (LATITUDE, LONGITUDE)
            )
            word = self.flags(METHOD)[int(self.array(METHOD)[mission])]
            return latitude, longitude, METHODS[word]
        start, end = self.fixes(mission)
        north, east = (self.signal(f"measured_onboard_{n}", mission) for n in ("north", "east"))
        known = np.isfinite(start).all() and np.isfinite(north).any()
        if known and abs(start[0]) <= HIGHEST_LATITUDE:
            return *position(north, east, *start), "on-board track"
        if not np.isfinite((*start, *end)).all():
            return np.full(count, np.nan), np.full(count, np.nan), METHODS["unknown"]
        share = np.linspace(0.0, 1.0, count)
        turn = (end[1] - start[1] + 180.0) % 360.0 - 180.0
        latitude = start[0] + share * (end[0] - start[0])
        return latitude, start[1] + share * turn, METHODS["straight_line"]


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class LoggedTrajectory(Trajectory):
    """Dives of a log, one or several in a row, on one clock and in one frame."""

    sources: dict[str, str]
    """Source of each true_* signal, such as {"true_north": "corrected track"}"""
    starts: tuple[int, ...] = (0,)
    """Number of the first sample of each dive"""
    vehicle: str | None = None
    """Vehicle whose flight model made the estimates; None if no flight model was used"""
    unflown: str = ""
    """Reason why no flight model was used"""

    @property
    def actuators(self) -> tuple[str, ...]:
        """Moving parts whose positions the log has; their commands may be missing."""
        return tuple(part for part in actuator_names(VARIABLES) if f"true_{part}" in self)

    def geographic_position(self) -> tuple[Array, Array]:
        """Latitude and longitude [degree, WGS84] of the track, each of shape (time,).

        Raises:
          InputError: the provenance has no start position.
        """
        if START_LATITUDE not in self.provenance:
            raise InputError("this log does not say where on Earth it began")
        place = (self.provenance[START_LATITUDE], self.provenance[START_LONGITUDE])
        latitude, longitude = position(self["true_north"], self["true_east"], *place)
        return latitude, wrap_longitude(longitude)

    def distance_through_water(self) -> Array:
        """Path length through the water [m] up to each sample, shape (time,); samples of unknown
        speed add nothing."""
        speed = np.nan_to_num(np.linalg.norm(self.v_rel, axis=-1), nan=0.0)
        return cumulative(speed, self.time)


def source_of(trajectory: Trajectory, name: str, default: str) -> str:
    """Name the source of a true_* signal of a trajectory, such as "corrected track".

    Args:
      name: name of the signal, such as "true_north".
      default: result for a simulated trajectory, such as "truth".
    """
    if isinstance(trajectory, LoggedTrajectory):
        return trajectory.sources.get(name, default)
    return default


AVERAGED = "depth-averaged current"
"""Source of a current with one value for each dive"""
MEASURED = "measured"
"""Source of a signal that the log's own sensor measured"""
