"""Legs: the descents and climbs of a dive, from its depth."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Phase = Literal["dive", "climb"]
PHASES: tuple[Phase, ...] = ("dive", "climb")

REVERSAL = 5.0
"""[m] of the other way that end a leg: `factory import` calls a dive what is deeper than this"""
LEAST_RANGE = 15.0
"""[m] of a leg that is compared; a shorter one is an inflection and little else"""
MARGIN, LEAST_MARGIN = 0.1, 3.0
"""Part of a leg's range, and metres at least, that are inflection at either end of it"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Leg:
    """A descent or a climb: samples `first` to `last`."""

    first: int
    last: int
    phase: Phase
    top: float
    """[m]"""
    bottom: float
    """[m]"""

    @property
    def samples(self) -> slice:
        """Its samples."""
        return slice(self.first, self.last + 1)

    @property
    def band(self) -> tuple[float, float]:
        """Depths [m] between which it is away from its inflections."""
        margin = max(MARGIN * (self.bottom - self.top), LEAST_MARGIN)
        return self.top + margin, self.bottom - margin

    @property
    def compared(self) -> bool:
        """Whether it is long enough to be compared."""
        return self.bottom - self.top >= LEAST_RANGE


def legs_of(depth: Array) -> list[Leg]:
    """Descents and climbs in their order; `depth` [m], (time,), without NaN."""
    turns = _turns(depth)
    legs = []
    for a, b in itertools.pairwise(turns):
        phase: Phase = "dive" if depth[b] > depth[a] else "climb"
        ends = sorted((float(depth[a]), float(depth[b])))
        legs.append(Leg(first=a, last=b, phase=phase, top=ends[0], bottom=ends[1]))
    return legs


def _turns(depth: Array) -> list[int]:
    """Samples at which the depth turns round by REVERSAL, with the ends of what moves so far."""
    turns: list[int] = []
    low = high = way = 0
    for k, z in enumerate(depth):
        low = k if z <= depth[low] else low
        high = k if z >= depth[high] else high
        if way <= 0 and z - depth[low] >= REVERSAL:
            turns.append(low)
            high, way = k, 1
        elif way >= 0 and depth[high] - z >= REVERSAL:
            turns.append(high)
            low, way = k, -1
    if way:
        turns.append(high if way > 0 else low)
    return turns
