"""Bounds: what a channel of any vehicle, simulated or real, can be.

They are wider than any vehicle's own limits and than the factory's bounds of a simulated truth,
since sensors have noise and saturate: what lies outside is damage, a sentinel or a wrong unit.
"""

from __future__ import annotations

import math

from twin.records.schema import VARIABLES

UNIT_BOUNDS = {
    "m s-1": (-10.0, 10.0), "rad s-1": (-35.0, 35.0), "m s-2": (-160.0, 160.0),
    "degree": (-360.0, 360.0), "cm3": (-5000.0, 5000.0), "kg": (-100.0, 100.0),
    "kg m-3": (900.0, 1100.0), "dbar": (-20.0, 12_000.0), "degree_Celsius": (-5.0, 50.0),
    "1": (-1.0, 1000.0),
}  # fmt: skip
"""By unit. No glider moves at 10 m/s; small gyroscopes end at 2000 deg/s and accelerometers at 16
times gravity; angles are counted from either side; buoyancy engines pump less than a litre."""
NAME_BOUNDS = {"depth": (-20.0, 12_000.0), "shift": (-1.0, 1.0)}
"""[m] by the end of the name: the deepest sea, and the length of half a hull."""
TRACK_BOUND = 1e7
"""[m] for positions: a quarter of the way round the Earth."""


def bounds(name: str) -> tuple[float, float]:
    """Lowest and highest possible value of a schema variable, in its unit."""
    variable = VARIABLES[name]
    if variable.limits is not None:
        return variable.limits
    for ending, limits in NAME_BOUNDS.items():
        if name.endswith(ending):
            return limits
    unit = variable.units
    if unit == "m":
        return (-TRACK_BOUND, TRACK_BOUND)
    return UNIT_BOUNDS.get(unit, (-math.inf, math.inf))
