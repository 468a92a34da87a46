"""Dives: tracks over ground between GPS fixes, and the depth-averaged current.

A steady uniform current leaves no trace in relative sensors, so a track over ground is a track
through the water plus an assumption about the current:

- `none`: the water stands still;
- `previous`: the depth-averaged current of the dive before, as gliders fly;
- `corrected`: the current of the dive itself, known after its end. The misclosure at the first fix
  after the dive is spread linearly in time over the dive (a linear ramp; Tethys' post-processing
  nudges its track to the fixes in the same way).

The depth-averaged current of a dive is its misclosure over its duration: fix at the end, minus fix
at the start, minus the track through the water in between (Eriksen et al. 2001).
"""

from __future__ import annotations

import dataclasses
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.navigation.dead_reckoning import Array, Signals

CurrentKnowledge = Literal["none", "previous", "corrected"]
KNOWLEDGE: tuple[CurrentKnowledge, ...] = get_args(CurrentKnowledge)

LEAST_DIVE_S = 300.0
"""[s] without a fix that make a dive, as the vehicle's own software has it (twin.sensors.onboard);
shorter gaps are missed fixes at the surface."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dive:
    """The time between two fixes that bracket a dive."""

    start: int
    """Sample of the last fix before it."""
    end: int
    """Sample of the first fix after it."""
    start_fix: Array
    """[m] north, east, (2,)"""
    end_fix: Array
    """[m] north, east, (2,)"""

    @property
    def span(self) -> slice:
        """Its samples, both fixes included."""
        return slice(self.start, self.end + 1)

    def seconds(self, period: float) -> float:
        """Duration [s]."""
        return (self.end - self.start) * period


def gps_fixes(signals: Signals) -> tuple[NDArray[np.intp], Array]:
    """Samples with a fix, (n,), and the fixes north, east [m], (n, 2); empty without a GPS."""
    names = ("measured_gps_north", "measured_gps_east")
    if any(name not in signals for name in names):
        return np.zeros(0, np.intp), np.zeros((0, 2))
    fixes = np.stack([np.asarray(signals[name], np.float64) for name in names], axis=1)
    index = np.flatnonzero(np.isfinite(fixes).all(axis=1))
    return index, fixes[index]


def find_dives(signals: Signals, period: float) -> list[Dive]:
    """The dives of a mission that have a fix before and after, in order of time."""
    index, fixes = gps_fixes(signals)
    gaps = np.flatnonzero(np.diff(index) * period >= LEAST_DIVE_S)
    return [
        Dive(start=int(index[k]), end=int(index[k + 1]), start_fix=fixes[k], end_fix=fixes[k + 1])
        for k in gaps
    ]


def depth_averaged_current(dive: Dive, water_track: Array, period: float) -> Array:
    """North, east [m/s], (2,), of one dive.

    Args:
      water_track: estimated track through the water [m], (time, 2), of the whole mission.
    """
    moved = water_track[dive.end] - water_track[dive.start]
    return (dive.end_fix - dive.start_fix - moved) / dive.seconds(period)


def dive_track(dive: Dive, water_track: Array, current: Array, period: float) -> Array:
    """Track over ground [m] from the dive's first fix on, (samples of the dive, 2).

    Args:
      water_track: estimated track through the water [m], (time, 2), of the whole mission.
      current: north, east [m/s], (2,), that is taken for the whole dive.
    """
    time = period * np.arange(dive.end - dive.start + 1)
    moved = water_track[dive.span] - water_track[dive.start]
    return dive.start_fix + moved + time[:, None] * current


def ground_track(
    water_track: Array,
    signals: Signals,
    period: float,
    *,
    knowledge: CurrentKnowledge = "previous",
    start: Array | None = None,
) -> Array:
    """Track over ground [m], (time, 2), re-initialised at every GPS fix.

    Args:
      water_track: estimated track through the water [m], (time, 2).
      knowledge: what is known about the current, see the module's text. With `corrected` the
        samples after the last fix use that dive's current.
      start: north, east [m] of the first sample, (2,); default the origin.

    Raises:
      InputError: unknown `knowledge`.
    """
    if knowledge not in KNOWLEDGE:
        raise InputError(unknown_name("knowledge of the current", knowledge, KNOWLEDGE))
    samples = len(water_track)
    index, fixes = gps_fixes(signals)
    dives = find_dives(signals, period)
    currents = [depth_averaged_current(dive, water_track, period) for dive in dives]
    known = np.zeros((samples, 2))
    if knowledge != "none":
        for dive, current in zip(dives, currents, strict=True):
            # "previous" learns it at the dive's end; "corrected" knows it from the dive's start on.
            known[dive.end if knowledge == "previous" else dive.start :] = current
    moved = np.array(water_track)
    moved[1:] += np.cumsum(known[:-1] * period, axis=0)  # each holds to the next sample
    anchors = np.zeros((samples, 2))
    anchors[:] = (np.zeros(2) if start is None else np.asarray(start)) - moved[0]
    for k, (sample, fix) in enumerate(zip(index, fixes, strict=True)):
        last = index[k + 1] if k + 1 < len(index) else samples
        anchors[sample:last] = fix - moved[sample]
    return moved + anchors
