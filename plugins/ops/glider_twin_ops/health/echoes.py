"""Echoes: which part of the echoes that a dive should have come back, by what earlier dives heard.

How much of a dive an altimeter hears the floor in depends on how deep it dives, how far the floor
is below and how its beam lies near the turn. So pings are counted by the height above the floor,
and a dive's echoes are beside those that earlier dives had at its heights. Its beam is plumb in a
dive; nose up, as a vehicle that still sinks after its turn, it looks aft and hears nothing: what is
pinged there says nothing of the altimeter.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BIN, BINS = 5.0, 60
"""[m] of height whose pings are counted together, and how many of them"""
LEAST = 10.0
"""Echoes that must be expected for a dive to tell"""
SOUND = 0.5
"""Part from which on a dive teaches the next: what a blind one hears is not what there is"""


@dataclasses.dataclass(eq=False)
class Echoes:
    """What the dives so far heard of the floor."""

    floor: float = math.nan
    """[m] its depth where it was heard last"""
    pings: Array = dataclasses.field(default_factory=lambda: np.zeros(BINS))
    heard: Array = dataclasses.field(default_factory=lambda: np.zeros(BINS))

    def part(self, depth: Array, altitude: Array, pitch: Array | None = None) -> float:
        """Echoes of the next dive over those expected [1]; NaN where too few are, as at first.

        Args:
          depth, altitude: [m], (n,); altitude NaN where no echo came back.
          pitch: [degree], nose up positive, (n,); None: not known.
        """
        down = np.isfinite(depth) & (np.diff(depth, prepend=math.nan) > 0.0)
        if pitch is not None:
            down &= ~(pitch > 0.0)
        deep, back = depth[down], np.isfinite(altitude[down])
        found = math.nan
        if back.sum() >= LEAST:
            found = float(np.median((deep + altitude[down])[back]))
        if found > self.floor + BIN:
            self.floor = found  # deeper than it was: echoes that are due are those of today's
        elif deep.size and deep.max() > self.floor + BIN:
            self.floor = math.nan  # it dived to below where the floor was heard
        part = math.nan
        if math.isfinite(self.floor):
            at = self._bins(self.floor - deep)
            expected = float((self.heard / np.maximum(self.pings, 1.0))[at].sum())
            known = self.pings[at] > 0.0
            part = float((back & known).sum()) / expected if expected >= LEAST else math.nan
        if math.isfinite(found) and not part < SOUND:
            self.floor = found
            at = self._bins(self.floor - deep)
            self.pings += np.bincount(at, minlength=BINS)
            self.heard += np.bincount(at, back, BINS)
        return part

    @staticmethod
    def _bins(height: Array) -> NDArray[np.int64]:
        return np.clip(height / BIN, 0, BINS - 1).astype(np.int64)
