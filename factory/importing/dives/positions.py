"""Positions of a vehicle at each sample of a row, and the depth-averaged current of a dive.

The track through the water is reckoned from depth rate, pitch and heading. Without these, the
vehicle's own track is used; without that track, zero velocity through the water. The misclosure at
the GPS fixes is distributed linearly in time (`twin.logs.corrected_track`), so that the track meets
every fix. With zero velocity the track is the straight line between fixes, and unknown outside
them. `twin flight` is more accurate: it uses a model of the vehicle.

The current is the displacement between two fixes minus that through the water, divided by the time.
Fixes and tracks of the log are in metres from the row's start.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import NEAR, Channel, DeploymentLog
from factory.importing.dives.dive_checks import floating
from factory.importing.dives.segments import NOWHERE, SURFACE, LogSegment
from twin.geodesy import offset, position, wrap_longitude
from twin.records.coordinates import rounded_degrees
from twin.records.logged import DRIVEN
from twin.water.current.axes import HIGHEST_LATITUDE

ATTACK = 3.0
"""[degree] Angle between a glider's nose and its path, as OceanGliders recommend."""
CURRENT_METHOD = (
    "(displacement over ground between the fixes - displacement through the water) / dive_duration;"
    " through the water at depth rate / tan(|pitch| + 3 degree) along the true heading, zero at the"
    " surface, bridged where |pitch| is below 10 degree. NaN without two fixes, pitch or heading,"
    " for dives that the log does not hold to their end, and under propulsion"
)
"""Comment on the current in a store's attributes."""
_STEEP = 10.0
"""[degree] Smallest pitch of a glide; in flatter stretches the speed is interpolated."""
_WINDOW = 20.0
"""[s] Averaging time of pitch and depth rate."""
_AFLOAT = 1.0
"""[m] Depth above which a glider lies at the surface."""
_KNOWN = 0.9
"""Smallest fraction of the time under water that has original samples."""
_FEWEST = 10
"""Minimum number of samples of a glide that give a speed."""


def averaged_current(
    signals: Mapping[str, Array],
    segment: LogSegment,
    period: float,
    *,
    complete: bool = True,
    driven: float = 0.0,
) -> tuple[float, float]:
    """North and east [m/s] of a row's depth-averaged current; NaN where unknown.

    Args:
      signals: signals of the row, on its grid.
      period: [s] sampling interval of the grid.
      complete: True if the log covers the dive to its end.
      driven: fraction of the time with the thruster on.
    """
    velocity = through_water(signals, period, driven=driven)
    if velocity is None or not complete or not np.isfinite(segment.displacement).all():
        return NOWHERE
    # trapezoidal rule: the first and last sample are the fixes
    weight = np.full(len(velocity), period)
    weight[[0, -1]] *= 0.5
    north, east = (float(np.sum(weight * axis)) for axis in velocity.T)
    return (
        (segment.displacement[0] - north) / segment.duration,
        (segment.displacement[1] - east) / segment.duration,
    )


def through_water(
    signals: Mapping[str, Array], period: float, *, driven: float = 0.0
) -> Array | None:
    """North and east velocity [m/s] through the water by depth rate and pitch, (time, 2).

    None without such signals, without a glide, for a log with gaps, or under propulsion.

    Args:
      signals, period, driven: as in `averaged_current`.
    """
    names = ("measured_depth", "measured_pitch", "measured_heading", "measured_phase")
    if any(name not in signals for name in names) or driven > DRIVEN:
        return None
    depth, phase = signals["measured_depth"], signals["measured_phase"]
    pitch, heading = (_bridged(signals[name]) for name in ("measured_pitch", "measured_heading"))
    known = signals["measured_gap"] < 0.5
    under = (depth > _AFLOAT) & (phase != SURFACE)
    if not under.any() or known[under].mean() < _KNOWN:
        return None
    speed, course = level_speed(depth, pitch, period), np.radians(heading)
    if speed is None:
        return None
    speed = np.where(under, speed, 0.0)
    velocity = np.stack([speed * np.cos(course), speed * np.sin(course)], axis=1)
    return velocity if np.isfinite(velocity).all() else None


def _bridged(degrees: Array) -> Array:
    """Interpolate gaps of angles [degree] the short way round; hold the end values outside."""
    known = np.isfinite(degrees)
    index = np.arange(len(degrees))
    turned = np.degrees(np.unwrap(np.radians(degrees[known])))
    return np.interp(index, index[known], turned) if known.any() else degrees


def level_speed(depth: Array, pitch: Array, period: float) -> Array | None:
    """[m/s] Horizontal speed through the water; None without a glide.

    Args:
      depth: [m], (time,).
      pitch: [degree], (time,).
    """
    rate = np.gradient(_mean(depth, period), period)
    slope = _mean(pitch, period)
    # a glider sinks nose down and rises nose up
    good = (np.abs(slope) > _STEEP) & (rate * slope < 0.0) & (depth > _AFLOAT)
    if good.sum() < _FEWEST:
        return None
    path = np.radians(np.maximum(np.abs(slope), _STEEP) + ATTACK)
    index = np.arange(len(depth))
    return np.interp(index, index[good], (np.abs(rate) / np.tan(path))[good])


def _mean(values: Array, period: float) -> Array:
    """Running mean over `_WINDOW`, the end values repeated outside."""
    half = max(round(0.5 * _WINDOW / period), 0)
    if half == 0 or len(values) < 2:
        return values
    padded = np.pad(values, half, mode="edge")
    return np.convolve(padded, np.full(2 * half + 1, 1.0 / (2 * half + 1)), mode="valid")


Array = NDArray[np.float64]


class Positions(NamedTuple):
    """Positions of a row's samples."""

    latitude: Array
    """[degree] North, (time,); NaN where unknown."""
    longitude: Array
    """[degree] East, (time,)."""
    method: str
    """Method, one of `twin.records.coordinates.METHODS`."""


def row_positions(
    signals: Mapping[str, Array],
    origin: tuple[float, float] | None,
    period: float,
    *,
    driven: float = 0.0,
) -> Positions:
    """Estimate the positions of a row's samples.

    Args:
      signals: signals of the row, on its grid.
      origin: latitude and longitude [degree] of the row's frame.
      period: [s] sampling interval of the grid.
      driven: fraction of the time with the thruster on: then depth rate does not give the speed.
    """
    from twin.logs.corrected_track import Drift, linear_track, track_velocity
    from twin.logs.track import Fixes

    def pair(name: str) -> Array | None:
        names = [f"{name}_north", f"{name}_east"]
        there = set(names) <= set(signals)
        return np.stack([signals[one] for one in names], axis=1) if there else None

    nothing = np.full(len(signals["measured_gap"]), np.nan)
    nowhere = Positions(nothing, nothing, "unknown")
    found = pair("measured_gps")
    if origin is None or abs(origin[0]) > HIGHEST_LATITUDE or found is None:
        return nowhere
    sample = np.flatnonzero(np.isfinite(found).all(axis=1))
    if not len(sample):
        return nowhere
    fixes = Fixes(sample=sample, position=found[sample])
    velocity, method = through_water(signals, period, driven=driven), "depth_rate_and_pitch"
    own = pair("measured_onboard")
    if velocity is None and own is not None:
        velocity, method = track_velocity(own, period, fixes), "onboard_track"
    if velocity is None:
        velocity, method = np.zeros((len(nothing), 2)), "straight_line"
    track, _ = linear_track(velocity, period, fixes, Drift(diffusivity=0.0, change=0.0))
    if method == "straight_line":
        track[: sample[0]], track[sample[-1] + 1 :] = np.nan, np.nan
    latitude, longitude = position(track[:, 0], track[:, 1], *origin)
    return Positions(rounded_degrees(latitude), rounded_degrees(wrap_longitude(longitude)), method)


def put_fixes(
    log: DeploymentLog, segment: LogSegment, times: Array, period: float, signals: dict[str, Array]
) -> None:
    """Add GPS positions [m] from the row's start at the samples nearest to its fixes."""
    origin = frame_origin(log, segment)
    if origin is None:
        return
    north, east = np.full(len(times), np.nan), np.full(len(times), np.nan)
    if len(segment.inside):
        k = np.clip(np.round((segment.inside.time - times[0]) / period), 0, len(times) - 1)
        place = offset(segment.inside.latitude, segment.inside.longitude, *origin)
        north[k.astype(np.intp)], east[k.astype(np.intp)] = place
    for fix, k in ((segment.start_fix, 0), (segment.end_fix, len(times) - 1)):
        if fix is not None:
            north[k], east[k] = offset(np.float64(fix[0]), np.float64(fix[1]), *origin)
    signals["measured_gps_north"], signals["measured_gps_east"] = north, east


def frame_origin(log: DeploymentLog, segment: LogSegment) -> tuple[float, float] | None:
    """Latitude and longitude [degree] of the origin of a row's frame; None without a fix."""
    inside = segment.inside
    if len(inside):
        first = float(inside.latitude[0]), float(inside.longitude[0])
        return segment.start_fix or _onboard_at(log, segment.start) or first
    return segment.start_fix or segment.end_fix


def _onboard_at(log: DeploymentLog, time: float) -> tuple[float, float] | None:
    """Latitude and longitude of the vehicle's own track at a time; None without one."""
    latitude, longitude = log.channel("latitude"), log.channel("longitude")
    if not len(latitude) or not len(longitude):
        return None
    at = np.array([time])
    return float(latitude.at(at)[0]), float(longitude.at(at)[0])


def put_true_track(
    log: DeploymentLog, segment: LogSegment, times: Array, signals: dict[str, Array]
) -> None:
    """Add a simulated vehicle's true positions [m] from the row's start, which is a fix."""
    latitude, longitude = log.channel("true_latitude"), log.channel("true_longitude")
    origin = segment.start_fix or segment.end_fix
    if origin is not None and len(latitude):
        values = offset(latitude.at(times), longitude.at(times), *origin)
        signals["true_north"], signals["true_east"] = values


def put_onboard(
    log: DeploymentLog, segment: LogSegment, times: Array, signals: dict[str, Array]
) -> None:
    """Add the vehicle's own track [m] from the row's start, before the end fix corrects it."""
    span = segment.start, segment.end - 1e-3
    north, east = log.channel("onboard_north"), log.channel("onboard_east")
    latitude, longitude = log.channel("latitude"), log.channel("longitude")
    if len(latitude) and len(longitude) and not len(north):
        origin = segment.start_fix or _onboard_at(log, segment.start)
        assert origin is not None
        common = latitude.within(*span)
        values = offset(common.values, longitude.at(common.time), *origin)
        north, east = (Channel(common.time, axis) for axis in values)
    else:
        north, east = north.within(*span), east.within(*span)
        north, east = (Channel(one.time, one.values - one.values[:1]) for one in (north, east))
    if len(north) < 2 or len(east) < 2:
        return
    # linear between positions, and held beyond the ends for the longest step
    longest = max(NEAR, float(np.diff(north.time).max()))
    known = (times >= north.time[0] - longest) & (times <= north.time[-1] + longest)
    known |= floating(north, log, segment, times)
    signals["measured_onboard_north"] = np.where(known, north.at(times), np.nan)
    signals["measured_onboard_east"] = np.where(known, east.at(times), np.nan)
