"""Limits: lowest and highest possible value of every variable, for any vehicle and mission.

A value outside these wide limits is damage, a sentinel, a wrong unit or an unstable simulation.
Each row of `TABLE` is one quantity. The limits of a variable are the first row with the variable's
unit whose `ending` ends the variable's name.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.records.schema import variable

Array = NDArray[np.float64]


class LimitedQuantity(NamedTuple):
    """Limits of every variable with this unit and this ending of its name."""

    units: str
    ending: str
    recorded: tuple[float, float]
    """Limits of any stored channel: a sensor's range, with noise and saturation."""
    simulated: tuple[float, float] | None = None
    """Narrower limits of simulated truth and commands, which have no noise and no full scale.

    An unstable simulation must be detected before its numbers overflow."""


TABLE: tuple[LimitedQuantity, ...] = (
    # the deepest sea floor is at 10 935 m; waves and pressure offsets make depths negative
    LimitedQuantity("m", "depth", (-20.0, 12_000.0)),
    LimitedQuantity("m", "altitude", (-20.0, 12_000.0)),
    # half a hull's length
    LimitedQuantity("m", "shift", (-1.0, 1.0)),
    # a quarter of the Earth's circumference; 1000 km in one simulated mission
    LimitedQuantity("m", "", (-1e7, 1e7), (-1e6, 1e6)),
    # a year
    LimitedQuantity("s", "", (-3.2e7, 3.2e7)),
    # no glider reaches 5 m/s; a single ping of a Doppler log may exceed it
    LimitedQuantity("m s-1", "", (-10.0, 10.0), (-5.0, 5.0)),
    # full scale of small gyroscopes: 2000 degree/s
    LimitedQuantity("rad s-1", "", (-35.0, 35.0), (-10.0, 10.0)),
    # full scale of small accelerometers: 16 times gravity
    LimitedQuantity("m s-2", "", (-160.0, 160.0), (-100.0, 100.0)),
    # other programs store headings from -180; this one from 0
    LimitedQuantity("degree", "heading", (-180.0, 360.0), (0.0, 360.0)),
    LimitedQuantity("degree", "pitch", (-90.0, 90.0)),
    LimitedQuantity("degree", "roll", (-180.0, 180.0)),
    LimitedQuantity("degree", "fin", (-90.0, 90.0)),
    # a full turn in either direction
    LimitedQuantity("degree", "", (-360.0, 360.0), (-180.0, 360.0)),
    # small gliders pump less than a litre, flying wings some tens of litres
    LimitedQuantity("cm3", "", (-50_000.0, 50_000.0)),
    LimitedQuantity("kg", "", (-100.0, 100.0)),
    # fresh water at the surface to brine at the deepest sea floor; a cell may also hold air
    LimitedQuantity("kg m-3", "", (900.0, 1100.0)),
    LimitedQuantity("dbar", "", (-20.0, 12_000.0)),
    # freezing brine to a sunlit deck
    LimitedQuantity("degree_Celsius", "", (-5.0, 45.0)),
    # a counter may count the remaining charge; the largest vehicles carry some thousand A h
    LimitedQuantity("A h", "", (-1e4, 1e5)),
    LimitedQuantity("V", "", (0.0, 500.0)),
    # negative while the battery charges on deck
    LimitedQuantity("A", "", (-100.0, 500.0)),
    LimitedQuantity("W", "", (0.0, 1e4)),
    # overpressure in a warm hull to a vacuum inside
    LimitedQuantity("Pa", "", (-5e4, 101_325.0)),
    # fresh water to warm brine
    LimitedQuantity("S m-1", "", (-0.1, 10.0)),
    LimitedQuantity("1", "immersion", (-1e-6, 1.0 + 1e-6)),
    LimitedQuantity("1", "contact", (0.0, 1.0)),
    LimitedQuantity("1", "dvl_mode", (0.0, 2.0)),
    LimitedQuantity("1", "salinity", (0.0, 50.0)),
    LimitedQuantity("1", "phase", (0.0, 3.0)),
    LimitedQuantity("1", "gap", (0.0, 1.0)),
    # segment numbers; -1 before the first segment
    LimitedQuantity("1", "", (-1.0, 1000.0)),
)


def quantity(name: str) -> LimitedQuantity:
    """Return the row of limits for a variable of the schema.

    Raises:
      KeyError: no such variable, with the nearest name.
      LookupError: the variable's unit has no limits yet.
    """
    found = variable(name)
    if found.limits is not None:  # the sensor that declared the signal gave the limits
        return LimitedQuantity(found.units, name, found.limits)
    units = found.units
    for row in TABLE:
        if row.units == units and name.endswith(row.ending):
            return row
    raise LookupError(f"variable {name!r}: add limits for the unit {units!r} to {__name__}.TABLE")


PRESSURE_RATIO = 0.98, 1.08
"""[dbar/m] Lowest and highest ratio of pressure to depth in any ocean, TEOS-10 to 11 km"""
RATIO_DEPTH = 20.0
"""[m] Smallest depth at which that ratio is checked; shallower, pressure offsets dominate."""
FASTEST_DEPTH = 5.0
"""[m/s] Highest vertical speed of a glider; a faster change of depth is a fault."""


def depth_faults(depth: Array, pressure: Array | None, period: float) -> list[tuple[str, str]]:
    """Find impossible depth changes and pressures: for each fault its text and the value found.

    Args:
      depth: [m], every `period` [s], NaN where it is unknown, (samples,).
      pressure: [dbar], (samples,); None skips the check of the ratio.
    """
    found = []
    rate = np.abs(np.diff(depth)) / period
    fastest = float(np.nanmax(rate, initial=0.0))
    if fastest > FASTEST_DEPTH:
        where = f"{fastest:.3g} m/s at sample {int(np.argmax(rate == fastest))}"
        found.append((f"the depth changes by more than {FASTEST_DEPTH:g} m/s", where))
    if pressure is None:
        return found
    deep = depth > RATIO_DEPTH
    ratio = pressure[deep] / depth[deep]
    ratio = ratio[np.isfinite(ratio)]
    low, high = PRESSURE_RATIO
    if not ((ratio > low) & (ratio < high)).all():
        why = f"pressure over depth is outside of {low:g} to {high:g} dbar/m"
        found.append((why, f"{ratio.min():.3g} to {ratio.max():.3g} dbar/m"))
    return found


def recorded_limits(name: str) -> tuple[float, float]:
    """Return the lowest and highest value of a variable in any store, in the variable's unit."""
    return quantity(name).recorded


def simulated_limits(name: str) -> tuple[float, float]:
    """Return `recorded_limits`, or narrower limits for the truth and commands of a simulation."""
    row = quantity(name)
    if name.startswith("measured_") or row.simulated is None:
        return row.recorded
    return row.simulated
