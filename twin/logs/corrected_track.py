"""Corrected tracks over ground: dead reckoning corrected at GPS fixes, and depth-averaged currents.

The depth-averaged current of a dive is its displacement over ground between two fixes, minus its
displacement through the water, divided by the time (Eriksen et al. 2001, IEEE J. Oceanic Eng. 26).

There are two corrections. `smoother` runs a current filter over all fixes of a deployment
(`twin.logs.track`); `twin flight` and the exports use it. `linear` serves comparisons and quick
looks.

In the linear correction, a dead-reckoned track misses the second of two fixes because of the
current and the speed's errors. The misclosure is spread linearly in time: a constant current from
fix to fix. The remaining error between the fixes is modelled as a random walk tied to both fixes
(a Brownian bridge). Its variance is d t (T - t) / T, with t the time after one fix and T the time
from fix to fix. The diffusivity d follows from how the depth-averaged current changes from dive to
dive.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import UnknownName
from twin.identify.speed import way_of
from twin.logs.track import Array, Fixes, SmoothedWay, smoothed_tracks, track_parameters

LEAST_INTERVAL = 300.0
"""[s] Shortest time between two fixes for a current: in a minute at the surface, the noise of the
fixes would look like a current of 10 cm/s."""
UNDER_WATER = 3.0
"""[m] Depth that a dive must exceed between two fixes; shallower, the vehicle is at the surface"""
SPEED_DEVIATION = 0.02
"""[m/s] Standard deviation of a flight model's speed; 0.014 against a Doppler log (real_logs.md)"""
HEADING_DEVIATION = math.radians(2.0)
"""[rad] Standard deviation of the heading of a calibrated compass"""
FOLLOWS_WITHIN = 3600.0
"""[s] Longest time between two dives whose currents are compared"""
USUAL_CHANGE = 0.03
"""[m/s] Standard deviation, north and east each, of the current's change from dive to dive, for a
log with too few dives. 23 dives off Newfoundland: 0.02 to 0.03 (docs/results/real_logs.md)."""
USUAL_DURATION = 7200.0
"""[s] Duration of the dives that `USUAL_CHANGE` was measured from"""
LEAST_PAIRS = 3
"""Minimum number of pairs of successive dives from which a log's own statistics are computed"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Drift:
    """Statistics of the currents of a deployment."""

    diffusivity: float
    """[m2/s] Growth of the position's variance with time, north and east each"""
    change: float
    """[m/s] Standard deviation of the current's change from dive to dive, north and east each"""
    usual: tuple[float, float] = (0.0, 0.0)
    """[m/s] Median current, north and east, used for a mission without two fixes"""


SMOOTHER, LINEAR = "smoother", "linear"
CORRECTIONS = (SMOOTHER, LINEAR)
NOMINAL_LATITUDE = 45.0
"""[degree] Latitude for the inertial period of a log without a position"""


def check_correction(name: str) -> None:
    """Raise UnknownName unless `name` is one of the two corrections."""
    if name not in CORRECTIONS:
        raise UnknownName("correction of tracks", name, CORRECTIONS)


def corrected_tracks(
    records: Sequence[Sequence[SmoothedWay]], period: float, latitudes: Sequence[float]
) -> list[list[tuple[Array, Array]]]:
    """Smooth several deployments' tracks: position and its standard deviation, track by track.

    Args:
      records: the tracks of each deployment, in similar water, such as those of one store. Each
        deployment is smoothed alone; the current's parameters are fitted to all together.
      period: [s] between samples.
      latitudes: [degree] of each deployment; `NOMINAL_LATITUDE` if one is NaN.
    """
    places = [x if np.isfinite(x) else NOMINAL_LATITUDE for x in latitudes]
    if not records:
        return []
    parameters = track_parameters(records, period, float(np.median(places)))
    return [
        smoothed_tracks(ways, period, latitude, parameters)
        for ways, latitude in zip(records, places, strict=True)
    ]


def corrected_track(
    velocity: Array, period: float, fixes: Fixes, latitude: float = NOMINAL_LATITUDE
) -> tuple[Array, Array]:
    """Smoothed track: position north, east [m], (time, 2), and standard deviation [m], (time,).

    Args:
      velocity: north, east through the water [m/s], (time, 2).
      period: [s] between samples.
      fixes: the fixes of the mission. A track without fixes begins at the origin.
      latitude: [degree]
    """
    way = SmoothedWay(velocity=velocity, fixes=fixes, start=0.0)
    return corrected_tracks([[way]], period, [latitude])[0][0]


def linear_track(velocity: Array, period: float, fixes: Fixes, drift: Drift) -> tuple[Array, Array]:
    """Linear track: position north, east [m], (time, 2), and standard deviation [m], (time,).

    At a fix the position is the fix. Before the first and after the last fix, the current between
    the two nearest fixes continues. If they are less than `LEAST_INTERVAL` apart, `drift.usual`
    continues. A track without fixes begins at the origin.

    Args:
      velocity, period, fixes: as `corrected_track`.
      drift: gives the standard deviation, and the current if two fixes are too close.
    """
    water = way_of(velocity, period)
    time = period * np.arange(len(velocity))
    usual = np.asarray(drift.usual, float)
    if not len(fixes):
        open_end = np.sqrt(_variance_outside_fixes(time, drift))
        return water + time[:, None] * usual, open_end
    at, places = fixes.sample, fixes.position
    missed = places - water[at]
    correction = np.stack([np.interp(time, time[at], missed[:, k]) for k in range(2)], axis=1)
    variance = np.zeros(len(time))
    for first, last in itertools.pairwise(at):
        inside = slice(first, last + 1)
        passed, left = time[inside] - time[first], time[last] - time[inside]
        variance[inside] = drift.diffusivity * passed * left / (time[last] - time[first])
    ends = ((slice(0, at[0]), 0, slice(0, 2)), (slice(at[-1] + 1, None), -1, slice(-2, None)))
    for outside, fix, pair in ends:
        away = time[outside] - time[at[fix]]
        current = usual
        if len(at) > 1 and (apart := np.diff(time[at[pair]])[0]) >= LEAST_INTERVAL:
            current = np.diff(missed[pair], axis=0)[0] / apart
        correction[outside] = missed[fix] + away[:, None] * current
        variance[outside] = _variance_outside_fixes(np.abs(away), drift)
    return water + correction, np.sqrt(fixes.deviation**2 + variance)


def track_velocity(track: Array, period: float, fixes: Fixes) -> Array | None:
    """Velocity north, east [m/s] of a vehicle's on-board track, (time, 2); None without a track.

    The on-board track jumps to each new GPS fix; the velocity excludes these jumps.

    Args:
      track: north, east [m], (time, 2), NaN where unknown.
      period: [s] between samples.
      fixes: the fixes of the mission.
    """
    known = np.isfinite(track).all(axis=1)
    if known.sum() < 2:
        return None
    index = np.arange(len(track))
    bridged = np.stack([np.interp(index, index[known], axis[known]) for axis in track.T], axis=1)
    steps = np.diff(bridged, axis=0)
    jumps = fixes.sample[(fixes.sample > 1) & (fixes.sample < len(track))]
    steps[jumps - 1] = steps[jumps - 2]
    return np.concatenate([steps, steps[-1:]]) / period


def _variance_outside_fixes(away: NDArray[np.floating], drift: Drift) -> Array:
    """Variance [m2] of a position at a time `away` [s] before the first fix or after the last."""
    return np.asarray((drift.change * away) ** 2 + drift.diffusivity * away)


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveCurrent:
    """Depth-averaged current of one dive."""

    mission: int
    """Row in the store."""
    first: int
    """Sample of the fix before the dive"""
    last: int
    """Sample of the fix after the dive"""
    start: float
    """[s] Time of the fix before the dive, on the deployment's clock; NaN without a clock"""
    duration: float
    """[s] Time between the fixes"""
    north: float
    """[m/s] northward current"""
    east: float
    """[m/s] eastward current"""
    deviation: float
    """[m/s] Standard deviation, north and east each, from the fixes, the speed and the heading"""


def currents(
    mission: int, velocity: Array, depth: Array, period: float, fixes: Fixes, start: float
) -> list[DiveCurrent]:
    """Depth-averaged currents of the dives of a mission, in order of time.

    Args:
      mission: row in the store.
      velocity: north, east through the water [m/s], (time, 2).
      depth: [m], (time,).
      period: [s] between samples.
      fixes: the fixes of the mission.
      start: [s] time of the first sample.
    """
    water = way_of(velocity, period)
    speed = np.hypot(*velocity.T)
    found = []
    for k, (first, last) in enumerate(zip(fixes.sample[:-1], fixes.sample[1:], strict=True)):
        under = depth[first : last + 1] > UNDER_WATER
        if not under.any():
            continue
        duration = period * float(last - first)
        moved = fixes.position[k + 1] - fixes.position[k] - (water[last] - water[first])
        swum = speed[first : last + 1][under]
        share = float(under.mean())
        along = SPEED_DEVIATION * share
        across = HEADING_DEVIATION * float(swum.mean()) * share
        located = math.sqrt(2.0) * fixes.deviation / duration
        found.append(
            DiveCurrent(
                mission=mission,
                first=int(first),
                last=int(last),
                start=start + period * float(first),
                duration=duration,
                north=float(moved[0]) / duration,
                east=float(moved[1]) / duration,
                deviation=math.sqrt(located**2 + 0.5 * (along**2 + across**2)),
            )
        )
    return found


def drift_of(found: Sequence[DiveCurrent]) -> Drift:
    """Statistics of the currents of one deployment's dives; `found` is in order of time.

    Let the currents of two dives of durations a and b differ by c. One dive over both would have
    missed the fix between them by c a b / (a + b). By the random walk, the variance of that
    misclosure is d a b / (a + b).
    """
    spreads, changes = [], []
    for one, next_one in itertools.pairwise(found):
        pause = next_one.start - (one.start + one.duration)
        if not -1.0 <= pause < FOLLOWS_WITHIN:
            continue
        squared = 0.5 * ((next_one.north - one.north) ** 2 + (next_one.east - one.east) ** 2)
        together = one.duration * next_one.duration / (one.duration + next_one.duration)
        spreads.append(squared * together)
        changes.append(squared)
    usual = (0.0, 0.0)
    if found:
        north, east = np.median([(one.north, one.east) for one in found], axis=0)
        usual = (float(north), float(east))
    diffusivity, change = 0.5 * USUAL_CHANGE**2 * USUAL_DURATION, USUAL_CHANGE
    if len(spreads) >= LEAST_PAIRS:
        diffusivity, change = float(np.mean(spreads)), math.sqrt(np.mean(changes))
    return Drift(diffusivity=diffusivity, change=change, usual=usual)
