"""Bounds: the values that a signal can physically have, whatever the mission.

They are wide: what lies outside is a simulation that has run away, damage, or a wrong unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

UNIT_BOUNDS = {
    "m s-1": (-5.0, 5.0), "rad s-1": (-10.0, 10.0), "m s-2": (-100.0, 100.0),
    "degree": (-180.0, 360.0), "cm3": (-1e5, 1e5), "kg": (-100.0, 100.0),
    "kg m-3": (900.0, 1100.0), "dbar": (-20.0, 12_000.0), "1": (-1.0, 1000.0),
}  # fmt: skip
"""Physically possible values by unit; no glider swims 5 m/s."""
NAME_BOUNDS = {
    "depth": (-20.0, 12_000.0), "shift": (-1.0, 1.0), "immersion": (-1e-6, 1.0 + 1e-6),
    "heading": (0.0, 360.0), "pitch": (-90.0, 90.0), "roll": (-180.0, 180.0),
    "dvl_mode": (0.0, 2.0),
}  # fmt: skip
"""Narrower ones by the end of the name"""
TRACK_BOUND = 1e6
"""[m] for tracks: 1000 km in one mission"""

ANY_VALUE = (-math.inf, math.inf)
"""of units of parts of one's own that say no limits"""


class Impossible(TwinError):
    """A simulation stayed finite and still left the possible, at `time_s`."""

    def __init__(self, message: str, *, time_s: float):
        super().__init__(message)
        self.time_s = time_s


def bounds(name: str) -> tuple[float, float]:
    """Possible values of a signal."""
    variable = VARIABLES[name]
    if variable.limits is not None:
        return variable.limits
    for ending, limits in NAME_BOUNDS.items():
        if name.endswith(ending):
            return limits
    unit = variable.units
    if unit == "m":
        return (-TRACK_BOUND, TRACK_BOUND)
    return UNIT_BOUNDS.get(unit, ANY_VALUE)


def check_possible(truth: Mapping[str, Array], time: Array) -> None:
    """Raise Impossible when a simulated signal leaves its bounds; NaN is left to others.

    Args:
      truth: signals of shape (time,), by name.
      time: [s], shape (time,).
    """
    earliest, culprit = len(time), ""
    for name, values in truth.items():
        low, high = bounds(name)
        outside = (values < low) | (values > high)
        if outside[:earliest].any():
            earliest, culprit = int(np.argmax(outside)), name
    if culprit:
        low, high = bounds(culprit)
        raise Impossible(
            f"{culprit} became {truth[culprit][earliest]:.3g} {VARIABLES[culprit].units} at "
            f"{time[earliest]:.1f} s, possible are {low:g} to {high:g}",
            time_s=float(time[earliest]),
        )
