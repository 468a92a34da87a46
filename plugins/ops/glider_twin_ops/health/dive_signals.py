"""Signals of a dive: what a log has of it, as the channels and answers of health read them.

Means of bins, gaps filled by straight lines, a pump's strokes, and what a pilot had set.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.numbers import Array

Mask = NDArray[np.bool_]
Signals = Mapping[str, Array]

PUMPING = 0.15
"""[cm3/s] from which a pump pumps"""
STEEP, LEAST_SAMPLES = 8.0, 20
"""[degree] and samples from which on a vehicle dives or climbs"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveSignals:
    """What a log has of one dive, each array (n,)."""

    period: float
    """[s]"""
    signals: Signals
    """by the names of the schema"""
    current: tuple[float, float] = (math.nan, math.nan)
    """north, east [m/s] between its fixes by the depth rate and the compass"""
    echoes: float = math.nan
    """of the floor, over those that earlier dives had at its heights"""
    powered: bool = False
    """A thruster drove it: neither its glide nor its power is that of others"""

    def get(self, name: str) -> Array | None:
        """A measured signal with a finite value."""
        found = self.signals.get(f"measured_{name}")
        return None if found is None or not np.isfinite(found).any() else found

    def settings(self) -> Settings:
        """Depth, pitches and volumes of the dive; NaN where the log does not tell."""
        depth, pitch, pump = self.get("depth"), self.get("pitch"), self.get("pump")
        found = [math.nan if depth is None else float(np.nanmax(depth))]
        for sign in (-1.0, 1.0):
            way = np.zeros(0, bool) if pitch is None else sign * pitch > STEEP
            for values in (pitch, pump):
                if values is None or way.sum() <= LEAST_SAMPLES:
                    found.append(math.nan)
                else:
                    found.append(float(np.nanmedian(values[way])))
        return Settings(*found)


class Settings(NamedTuple):
    """What a pilot had set in a dive, as its log shows it."""

    depth: float
    """[m] of the lower turn"""
    dive_pitch: float
    """[degree], nose up positive"""
    dive_volume: float
    """[cm3] that is pumped out"""
    climb_pitch: float
    climb_volume: float


class Strokes(NamedTuple):
    """When a pump pumps out, each (n,)."""

    rate: Array
    """[cm3/s] from the sample before"""
    out: Mask
    """it pumps out"""
    inner: Mask
    """both neighbours are of the stroke too: at an end a sample has a part of it alone"""


def strokes_of(volume: Array, period: float) -> Strokes:
    """Strokes of a pump's volume [cm3], (n,), with a period [s] between samples."""
    whole = filled(volume)
    rate = np.diff(whole, prepend=whole[:1]) / period
    out = rate > PUMPING
    inner = out.copy()
    inner[1:] &= out[:-1]
    inner[:-1] &= out[1:]
    return Strokes(rate, out, inner)


def binned(values: Array, width: int) -> Array:
    """Means of bins of so many samples; NaN are left out."""
    count = len(values) // width
    block = values[: count * width].reshape(count, width)
    known = np.isfinite(block)
    filled = np.where(known, block, 0.0).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(known.any(axis=1), filled / known.sum(axis=1), np.nan)


def filled(values: Array) -> Array:
    """Straight lines across NaN."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) == len(values):
        return values
    return np.interp(np.arange(len(values)), known, values[known])
