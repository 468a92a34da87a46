"""Flown tracks: the corrected tracks, velocities and currents that an OG1.0 file holds.

They are `twin.logs`'s where the vehicle's flight can be modelled. Where it cannot, the vehicle's
own dead-reckoned track is corrected at the fixes in the same way, and without one the straight line
between them; the file says which and why.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.logs import (
    DiveCurrent,
    Drift,
    Fixes,
    corrected_track,
    estimate_flight,
    linear_track,
)
from twin.logs.corrected_track import USUAL_CHANGE, USUAL_DURATION, track_velocity
from twin.logs.flight_estimator import FlownDive
from twin.logs.track import fixes_of, place_of
from twin.records.reader import MissionStore
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

BY_MODEL = "dead-reckoned by a flight model, smoothed with the current by all GPS fixes"
ON_BOARD = "on-board dead reckoning, smoothed with the current by the GPS fixes"
STRAIGHT = "straight line between GPS fixes"
UNKNOWN = "unknown: no GPS fix and no track"


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownTrack:
    """One mission's way over ground."""

    position: Array
    """North, east [m] from the mission's origin, (time, 2)"""
    deviation: Array
    """[m] standard deviation, each way, (time,)"""
    fixes: Fixes
    method: str
    """How it was found, for the file"""
    dive: FlownDive | None
    """What the flight model says; None without one"""
    currents: tuple[DiveCurrent, ...]
    """of its dives"""
    reckoned: Array
    """1 at each sample without a GPS fix, 0 at the fixes, (time,)"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownTracks:
    """The tracks of the missions of a store."""

    tracks: dict[int, FlownTrack]
    model: str
    """Which vehicle's flight model, or why there is none"""


def flown(
    run: MissionStore, missions: Sequence[int], vehicle: str | Vehicle | None = None
) -> FlownTracks:
    """Tracks of these missions.

    Args:
      run: the store.
      missions: rows of it.
      vehicle: file or name of the vehicle, which must be one that can be flown; default as
        `twin.logs.estimate_flight` has it.

    Raises:
      TwinError: the given vehicle cannot be flown on this store.
    """
    try:
        found = estimate_flight(run.path, vehicle, missions=missions)
    except TwinError as error:
        if vehicle is not None:
            raise
        reason = " ".join(str(error).split())
        tracks = {mission: _unmodelled(run, mission) for mission in missions}
        return FlownTracks(tracks=tracks, model=f"none: {reason}")
    tracks = {}
    for one in found.missions:
        mission = one.dive.mission
        if one.dive.motion is None:
            tracks[mission] = _unmodelled(run, mission)
            continue
        tracks[mission] = FlownTrack(
            position=one.position,
            deviation=one.deviation,
            fixes=one.fixes,
            method=BY_MODEL if len(one.fixes) else f"{BY_MODEL}; no fix",
            dive=one.dive,
            currents=tuple(c for c in found.currents if c.mission == mission),
            reckoned=_reckoned(run, mission),
        )
    return FlownTracks(
        tracks=tracks, model=f"flight model of vehicle {found.calibration.vehicle.name}"
    )


def _unmodelled(run: MissionStore, mission: int) -> FlownTrack:
    """By the vehicle's own track, or along straight lines."""
    fixes = fixes_of(run, mission)
    velocity = _on_board(run, mission, fixes)
    method = ON_BOARD
    if velocity is None:
        velocity, method = np.zeros((int(run.samples[mission]), 2)), STRAIGHT
    if method == STRAIGHT:
        usual = Drift(diffusivity=0.5 * USUAL_CHANGE**2 * USUAL_DURATION, change=USUAL_CHANGE)
        position, deviation = linear_track(velocity, run.period, fixes, usual)
    else:
        latitude = place_of(run, mission).latitude
        position, deviation = corrected_track(velocity, run.period, fixes, latitude)
    if method == STRAIGHT and not len(fixes):
        position[:], deviation[:], method = np.nan, np.nan, UNKNOWN
    return FlownTrack(
        position=position,
        deviation=deviation,
        fixes=fixes,
        method=method,
        dive=None,
        currents=(),
        reckoned=_reckoned(run, mission),
    )


def _reckoned(run: MissionStore, mission: int) -> Array:
    """1 where no GPS fix was taken, (time,)."""
    count = int(run.samples[mission])
    if "measured_gps_north" not in run:
        return np.ones(count)
    return 1.0 - np.isfinite(run.row("measured_gps_north", mission)[:count])


def _on_board(run: MissionStore, mission: int, fixes: Fixes) -> Array | None:
    """North, east [m/s] of the vehicle's own track, (time, 2); None without one."""
    names = ("measured_onboard_north", "measured_onboard_east")
    if any(name not in run for name in names):
        return None
    count = int(run.samples[mission])
    track = np.stack([run.row(name, mission)[:count].astype(float) for name in names], axis=1)
    return track_velocity(track, run.period, fixes)
