"""Fixes: where and when GPS said that a vehicle was, within one mission of a store."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.records.reader import MissionStore

Array = NDArray[np.float64]

GPS_DEVIATION = 5.0
"""[m] standard deviation, north and east each, of a receiver whose antenna is in the waves."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fixes:
    """The fixes of a mission, in order of time."""

    sample: NDArray[np.intp]
    """Index of the sample at which each was taken, (fix,), increasing."""
    position: Array
    """North, east [m] from the mission's origin, (fix, 2)."""
    deviation: float = GPS_DEVIATION
    """[m] north and east each"""

    def __len__(self) -> int:
        return len(self.sample)


def fixes_of(store: MissionStore, mission: int) -> Fixes:
    """The fixes of a mission of a store; none where it has no GPS.

    A simulated mission was launched at its origin: that place is known as a fix is, whether the
    receiver had one by then or not.
    """
    names = ("measured_gps_north", "measured_gps_east")
    if any(name not in store for name in names):
        return Fixes(sample=np.zeros(0, np.intp), position=np.zeros((0, 2)))
    count = int(store.samples[mission])
    found = np.stack([store.row(name, mission)[:count].astype(float) for name in names], axis=1)
    if not store.logged and not np.isfinite(found[0]).all():
        found[0] = 0.0
    sample = np.flatnonzero(np.isfinite(found).all(axis=1))
    return Fixes(sample=sample, position=found[sample])
