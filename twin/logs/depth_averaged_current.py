"""Current: the depth-averaged current of each dive between two fixes, and how much it changes.

Displacement over ground between the fixes, less that through the water, over the time between them
(Eriksen et al. 2001, IEEE J. Oceanic Eng. 26(4)).
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.logs.corrected_track import Drift
from twin.logs.fix import Fixes

Array = NDArray[np.float64]

UNDER_WATER = 3.0
"""[m] that a vehicle passes between two fixes of a dive; shallower it hangs at the surface"""
SPEED_DEVIATION = 0.02
"""[m/s] of a flight model's speed, against a Doppler log 0.017 (docs/results/real_logs.md)"""
HEADING_DEVIATION = math.radians(2.0)
"""[rad] of a calibrated compass: what its deviation leaves"""
FOLLOWS_WITHIN = 3600.0
"""[s] between two dives whose currents are compared"""
USUAL_CHANGE = 0.03
"""[m/s] of the current, each way, from dive to dive, where a log has too few: the median of 23
dives on the shelf off Newfoundland is 0.02 to 0.03 (docs/results/real_logs.md)."""
USUAL_DURATION = 7200.0
"""[s] of the dives of that figure"""
LEAST_PAIRS = 3
"""of dives that follow each other, for a figure of the log's own"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveCurrent:
    """The depth-averaged current of one dive."""

    mission: int
    """Row in the store."""
    first: int
    """Sample of the fix before the dive"""
    last: int
    """Sample of the fix after it"""
    start: float
    """[s] of the fix before, on the clock of the deployment; NaN without one"""
    duration: float
    """[s]"""
    north: float
    """[m/s]"""
    east: float
    """[m/s]"""
    deviation: float
    """[m/s] standard deviation, each way: of the fixes, the speed and the heading"""


def currents(
    mission: int, velocity: Array, depth: Array, period: float, fixes: Fixes, start: float
) -> list[DiveCurrent]:
    """The currents of the dives of a mission, in order of time.

    Args:
      mission: row in the store.
      velocity: north, east through the water [m/s], (time, 2).
      depth: [m], (time,).
      period: [s] between samples.
      fixes: of the mission.
      start: [s] of its first sample.
    """
    steps = 0.5 * period * (velocity[1:] + velocity[:-1])
    water = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
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
    """What the currents of one deployment's dives, in order of time, say of those in between.

    Two dives of durations a and b whose currents differ by c make up the bridge that one dive of
    both would have been: it would have missed the fix between them by c a b / (a + b), whose
    variance by the random walk is d a b / (a + b).
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
        usual = (
            float(np.median([one.north for one in found])),
            float(np.median([one.east for one in found])),
        )
    if len(spreads) < LEAST_PAIRS:
        return Drift(
            diffusivity=0.5 * USUAL_CHANGE**2 * USUAL_DURATION, change=USUAL_CHANGE, usual=usual
        )
    return Drift(
        diffusivity=float(np.mean(spreads)), change=math.sqrt(np.mean(changes)), usual=usual
    )
