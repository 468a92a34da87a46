"""Tracks of a deployment: GPS fixes, frames of missions, and smoothed tracks over ground.

`Fixes` holds the samples and positions at which GPS found a vehicle in one mission. `Place` holds
the origin of the mission's frame on Earth.

A current filter (`twin.navigation.current`) follows the track through the water from surface
interval to surface interval, and is smoothed. The current between two fixes then varies with the
tide, eddies and the neighbouring dives; to spread the error at the second fix evenly over the dive
would make it constant. Standard deviations are the smoother's. Afloat the track is linear.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.geodesy import from_tangent_plane, position, wrap_longitude
from twin.identify.speed import way_of
from twin.navigation.current import CurrentFilter, CurrentParameters, Leg, SmoothedTrack, tune
from twin.records.coordinates import START_LATITUDE, START_LONGITUDE
from twin.records.logged import numbers
from twin.records.reader import MissionStore

Array = NDArray[np.float64]

GPS_DEVIATION = 5.0
"""[m] Standard deviation, north and east each, of a fix with the antenna in waves."""
STAY = 300.0
"""[s] Longest time between two fixes of one surface interval; farther apart, a dive is between"""
PIECES, LEAST_PIECE = 16, 20.0
"""PIECES: maximum number of current filter steps in a dive. LEAST_PIECE: [s] shortest step"""
VELOCITY_SHARE = 0.012
"""[1] Standard deviation of the velocity through the water, north and east each, as a fraction of
speed: the difference of descents and climbs after correction of speed scale and compass"""
SHEAR_SHARE = 0.2
"""[1] Standard deviation of the current's change with depth, as a fraction of its mean speed"""
PHASE = 600.0
"""[s] Correlation time of the error VELOCITY_SHARE if the duration of a descent is unknown"""
SPEED_SCALE, COMPASS = 0.03, 2.0
"""Standard deviations. SPEED_SCALE: [1] of the speed scale, which the depth rate has corrected.
COMPASS: [degree] of a calibrated compass"""
ANYWHERE, LEAST_DEVIATION = 1e5, 1e-3
"""[m] Standard deviations. ANYWHERE: before the first fix. LEAST_DEVIATION: of a track's origin"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fixes:
    """GPS fixes of a mission, in order of time."""

    sample: NDArray[np.intp]
    """Index of the sample of each fix, (fix,), increasing."""
    position: Array
    """North, east [m] from the mission's origin, (fix, 2)."""
    deviation: float = GPS_DEVIATION
    """[m] Standard deviation, north and east each"""

    def __len__(self) -> int:
        return len(self.sample)


def fixes_of(store: MissionStore, mission: int) -> Fixes:
    """Read the fixes of a mission of a store; empty if the store has no GPS.

    The start of a simulated mission is its origin and counts as a fix, even if the receiver had
    none yet.
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
    """Fixes from positions [m], (time, 2), which are NaN in samples without a fix."""
    sample = np.flatnonzero(np.isfinite(known).all(axis=1))
    return Fixes(sample=sample, position=known[sample])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Place:
    """Origin of a mission's frame [degree], NaN if the store does not have it."""

    latitude: float
    longitude: float
    logged: bool
    """True for logs, whose metres follow the meridian and the mean parallel; simulated missions use
    the tangent plane at the origin (`twin.geodesy`)."""

    @property
    def known(self) -> bool:
        """True if the origin has a latitude and a longitude."""
        return bool(np.isfinite(self.latitude) and np.isfinite(self.longitude))

    def degrees(self, north: Array, east: Array) -> tuple[Array, Array]:
        """Latitude and longitude [degree] of points [m] in the frame; NaN without an origin."""
        if not self.known:
            return np.full_like(north, np.nan), np.full_like(east, np.nan)
        convert = position if self.logged else from_tangent_plane
        latitude, longitude = convert(north, east, self.latitude, self.longitude)
        return latitude, wrap_longitude(longitude)


def place_of(store: MissionStore, mission: int) -> Place:
    """Place of one mission of a store."""
    return places_of(store, [mission])[mission]


def places_of(store: MissionStore, missions: Sequence[int]) -> dict[int, Place]:
    """Places of the missions of a store, by mission."""
    latitude, longitude = (numbers(store, n) for n in (START_LATITUDE, START_LONGITUDE))
    make = functools.partial(Place, logged=store.logged)
    return {
        mission: make(latitude=float(latitude[mission]), longitude=float(longitude[mission]))
        for mission in missions
    }


@dataclasses.dataclass(frozen=True, kw_only=True)
class SmoothedWay:
    """Track of a mission through the water, and its fixes."""

    velocity: Array
    """North, east through the water [m/s], (time, 2)"""
    fixes: Fixes
    start: float
    """[s] Time of the first sample, on the deployment's clock; NaN where unknown"""
    phase: float = PHASE
    """[s] Duration of a descent or a climb"""

    def water(self, period: float) -> Array:
        """Displacement north, east through the water since the first sample [m], (time, 2)."""
        return way_of(self.velocity, period)


def smoothed_tracks(
    ways: Sequence[SmoothedWay],
    period: float,
    latitude: float,
    parameters: CurrentParameters,
) -> list[tuple[Array, Array]]:
    """Smooth tracks; each result has positions north, east [m] and their standard deviations [m].

    At a fix the position is the fix. A track without fixes begins at the origin.

    Args:
      ways: tracks through the water of one deployment.
      period: [s] between samples.
      latitude: [degree] of the deployment.
      parameters: parameters of the current, such as those of `track_parameters`.
    """
    order = sorted(range(len(ways)), key=lambda k: (not np.isfinite(ways[k].start), ways[k].start))
    found: dict[int, tuple[Array, Array]] = {}
    filter_: CurrentFilter | None = None
    knots: list[tuple[int, int, int]] = []
    for k in order:
        way = ways[k]
        apart = filter_ is None or not way.start >= filter_.time - 1.0
        if apart and filter_ is not None:
            _collect(found, ways, knots, filter_.smooth(), period)
        if apart or filter_ is None:
            begin = way.start if np.isfinite(way.start) else 0.0
            filter_ = CurrentFilter(
                parameters, latitude=latitude, time=begin, record=True, outlier=math.inf
            )
            knots = []
        elif way.start > filter_.time:
            filter_.step(way.start - filter_.time, None)
        knots += [(k, sample, node) for sample, node in _step_along(filter_, way, period)]
    if filter_ is not None:
        _collect(found, ways, knots, filter_.smooth(), period)
    return [found[k] for k in range(len(ways))]


def track_parameters(
    records: Sequence[Sequence[SmoothedWay]], period: float, latitude: float
) -> CurrentParameters:
    """Fit the parameters of the currents along tracks by maximum likelihood.

    Args:
      records: the tracks of each deployment; a simulated mission is a deployment of its own.
      period, latitude: as `smoothed_tracks`.
    """
    legs = []
    for ways in records:
        dated = [way for way in ways if np.isfinite(way.start)]
        legs.append(_legs(sorted(dated, key=lambda way: way.start), period))
        undated = [dataclasses.replace(w, start=0.0) for w in ways if not np.isfinite(w.start)]
        legs += [_legs([way], period) for way in undated]
    return tune(
        [], others=legs, latitude=latitude, speed_scale=SPEED_SCALE, compass=COMPASS,
        may_persist=False,
    ).parameters  # fmt: skip


def stays(fixes: Fixes, period: float) -> list[tuple[int, int]]:
    """Indices of the first and the last fix of each surface interval."""
    if not len(fixes):
        return []
    breaks = np.flatnonzero(np.diff(fixes.sample) * period >= STAY)
    first = np.concatenate([[0], breaks + 1])
    last = np.concatenate([breaks, [len(fixes) - 1]])
    return [(int(a), int(b)) for a, b in zip(first, last, strict=True)]


def _legs(ways: Sequence[SmoothedWay], period: float) -> list[Leg]:
    """Dives between surface intervals, of tracks in order of time."""
    legs: list[Leg] = []
    for way in ways:
        water, fixes = way.water(period), way.fixes
        for (_, last), (first, _) in itertools.pairwise(stays(fixes, period)):
            a, b = fixes.sample[last], fixes.sample[first]
            start = way.start + period * float(a)
            if legs and start < legs[-1].end - 1.0:
                continue
            ground, through = fixes.position[first] - fixes.position[last], water[b] - water[a]
            legs.append(
                Leg(
                    start=start,
                    duration=period * float(b - a),
                    over_ground=(float(ground[0]), float(ground[1])),
                    through_water=(float(through[0]), float(through[1])),
                )
            )
    return legs


def _step_along(filter_: CurrentFilter, way: SmoothedWay, period: float) -> list[tuple[int, int]]:
    """Step a filter along a track; return samples and the nodes of the filter's record at them."""
    water, fixes = way.water(period), way.fixes
    found = stays(fixes, period)
    end = len(water) - 1
    knots: list[tuple[int, int]] = []
    filter_.memory = way.phase

    def mark(sample: int) -> None:
        knots.append((sample, filter_.recorded - 1))

    def swim(first: int, last: int) -> None:
        duration = period * (last - first)
        count = max(1, min(PIECES, int(duration / LEAST_PIECE), last - first))
        edges = np.unique(np.linspace(first, last, count + 1).round().astype(int))
        for a, b in itertools.pairwise(edges):
            velocity = (water[b] - water[a]) / (period * (b - a))
            noise = VELOCITY_SHARE**2 * float(velocity @ velocity)
            noise += (SHEAR_SHARE * filter_.parameters.mean) ** 2
            filter_.step(period * float(b - a), velocity, noise * np.eye(2))
            mark(int(b))

    if not found:
        filter_.locate((0.0, 0.0), LEAST_DEVIATION)
        mark(0)
        swim(0, end)
        return knots
    begin = int(fixes.sample[found[0][0]])
    if begin > 0:
        filter_.locate(fixes.position[found[0][0]] - water[begin], ANYWHERE)
        mark(0)
        swim(0, begin)
    for k, (first, last) in enumerate(found):
        filter_.fix(fixes.position[first], fixes.deviation)
        if begin == 0 and k == 0:
            mark(0)
        if last > first:
            filter_.step(period * float(fixes.sample[last] - fixes.sample[first]), None)
            filter_.fix(fixes.position[last], fixes.deviation)
            mark(int(fixes.sample[last]))
        after = int(fixes.sample[found[k + 1][0]]) if k + 1 < len(found) else end
        if after > fixes.sample[last]:
            swim(int(fixes.sample[last]), after)
    return knots


def _collect(
    found: dict[int, tuple[Array, Array]],
    ways: Sequence[SmoothedWay],
    knots: Sequence[tuple[int, int, int]],
    track: SmoothedTrack,
    period: float,
) -> None:
    """Interpolate the positions of all samples from the nodes of a smoothed record."""
    for k in dict.fromkeys(way for way, _, _ in knots):
        own = [(sample, node) for way, sample, node in knots if way == k]
        samples, nodes = np.array(own).T
        samples, unique = np.unique(samples, return_index=True)
        nodes = nodes[unique]
        way = ways[k]
        water, index = way.water(period), np.arange(len(way.velocity))
        moved = track.position[nodes] - water[samples]
        variance = 0.5 * np.trace(track.position_covariance[nodes], axis1=1, axis2=2)
        fixes = way.fixes
        if len(fixes):
            # the residuals at the fixes are interpolated in time, so that the track meets each fix
            at = np.stack([np.interp(fixes.sample, samples, axis) for axis in moved.T], axis=1)
            left = fixes.position - water[fixes.sample] - at
            every = np.unique(np.concatenate([samples, fixes.sample]))
            along = [np.interp(every, samples, axis) for axis in moved.T]
            rest = [np.interp(every, fixes.sample, axis) for axis in left.T]
            moved = np.transpose(along) + np.transpose(rest)
            variance = np.interp(every, samples, variance)
            variance[np.searchsorted(every, fixes.sample)] = fixes.deviation**2
            samples = every
        position = water + np.stack([np.interp(index, samples, axis) for axis in moved.T], axis=1)
        deviation = np.sqrt(np.maximum(np.interp(index, samples, variance), 0.0))
        found[k] = position, deviation
