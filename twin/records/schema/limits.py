"""Limits: the values that a variable can have, whatever the vehicle and the mission.

They are wide: what lies outside is damage, a sentinel, a wrong unit, or a simulation that has run
away. One row is one quantity; a variable has the first row whose unit is its own and whose ending
its name has.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.records.schema import variable

Array = NDArray[np.float64]


class LimitedQuantity(NamedTuple):
    """The limits of every variable of a unit whose name ends so."""

    units: str
    ending: str
    recorded: tuple[float, float]
    """Of any channel that a store holds: what a sensor can say, noise and saturation included."""
    simulated: tuple[float, float] | None = None
    """Of the truth and the commands of a simulation, where these must be closer: a simulation has
    no noise and no full scale, and one that runs away must be told before its numbers overflow.
    """


TABLE: tuple[LimitedQuantity, ...] = (
    # the deepest sea has 10 935 m; waves and pressure offsets lift a vehicle out of it
    LimitedQuantity("m", "depth", (-20.0, 12_000.0)),
    LimitedQuantity("m", "altitude", (-20.0, 12_000.0)),
    # half a hull
    LimitedQuantity("m", "shift", (-1.0, 1.0)),
    # a quarter of the way round the Earth; 1000 km in one simulated mission
    LimitedQuantity("m", "", (-1e7, 1e7), (-1e6, 1e6)),
    # a year
    LimitedQuantity("s", "", (-3.2e7, 3.2e7)),
    # no glider swims 5 m/s; a Doppler log's single ping may say so
    LimitedQuantity("m s-1", "", (-10.0, 10.0), (-5.0, 5.0)),
    # small gyroscopes end at 2000 degree/s
    LimitedQuantity("rad s-1", "", (-35.0, 35.0), (-10.0, 10.0)),
    # small accelerometers end at 16 times gravity
    LimitedQuantity("m s-2", "", (-160.0, 160.0), (-100.0, 100.0)),
    # other programs count headings from -180; ours from 0
    LimitedQuantity("degree", "heading", (-180.0, 360.0), (0.0, 360.0)),
    LimitedQuantity("degree", "pitch", (-90.0, 90.0)),
    LimitedQuantity("degree", "roll", (-180.0, 180.0)),
    LimitedQuantity("degree", "fin", (-90.0, 90.0)),
    # a turn either way
    LimitedQuantity("degree", "", (-360.0, 360.0), (-180.0, 360.0)),
    # small gliders pump less than a litre, flying wings some tens of litres
    LimitedQuantity("cm3", "", (-50_000.0, 50_000.0)),
    LimitedQuantity("kg", "", (-100.0, 100.0)),
    # fresh water at the surface to brine at the deepest bottom, and air in a cell
    LimitedQuantity("kg m-3", "", (900.0, 1100.0)),
    LimitedQuantity("dbar", "", (-20.0, 12_000.0)),
    # freezing brine to a deck in the sun
    LimitedQuantity("degree_Celsius", "", (-5.0, 45.0)),
    # a counter may count what is left; the largest vehicles carry some thousand
    LimitedQuantity("A h", "", (-1e4, 1e5)),
    LimitedQuantity("V", "", (0.0, 500.0)),
    # charged on deck
    LimitedQuantity("A", "", (-100.0, 500.0)),
    LimitedQuantity("W", "", (0.0, 1e4)),
    # an overpressure of a warm hull to none inside
    LimitedQuantity("Pa", "", (-5e4, 101_325.0)),
    # fresh water to brine, warm
    LimitedQuantity("S m-1", "", (-0.1, 10.0)),
    LimitedQuantity("1", "immersion", (-1e-6, 1.0 + 1e-6)),
    LimitedQuantity("1", "contact", (0.0, 1.0)),
    LimitedQuantity("1", "dvl_mode", (0.0, 2.0)),
    LimitedQuantity("1", "salinity", (0.0, 50.0)),
    LimitedQuantity("1", "phase", (0.0, 3.0)),
    LimitedQuantity("1", "gap", (0.0, 1.0)),
    # numbers of segments, -1 before the first
    LimitedQuantity("1", "", (-1.0, 1000.0)),
)


def quantity(name: str) -> LimitedQuantity:
    """The row of a variable of the schema.

    Raises:
      KeyError: no such variable, with the nearest name.
      LookupError: its unit has no limits yet.
    """
    found = variable(name)
    if found.limits is not None:  # a signal that a sensor brought, with limits of its own
        return LimitedQuantity(found.units, name, found.limits)
    units = found.units
    for row in TABLE:
        if row.units == units and name.endswith(row.ending):
            return row
    raise LookupError(f"variable {name!r}: add limits for the unit {units!r} to {__name__}.TABLE")


PRESSURE_RATIO = 0.98, 1.08
"""[dbar/m] pressure over depth anywhere in the ocean, TEOS-10 to 11 km"""
RATIO_DEPTH = 20.0
"""[m] shallower the ratio is one of small numbers"""
FASTEST_DEPTH = 5.0
"""[m/s] no glider sinks or climbs so fast"""


def depth_faults(depth: Array, pressure: Array | None, period: float) -> list[tuple[str, str]]:
    """Find what no vehicle's depth does and no ocean's pressure is: a fault, and what was found.

    Args:
      depth: [m], on a grid of `period` [s], NaN where there is none, (samples,).
      pressure: [dbar], (samples,).
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
    """Lowest and highest value of a variable in any store, in its unit."""
    return quantity(name).recorded


def simulated_limits(name: str) -> tuple[float, float]:
    """As `recorded_limits`, of a simulated mission: truth and commands have closer ones."""
    row = quantity(name)
    if name.startswith("measured_") or row.simulated is None:
        return row.recorded
    return row.simulated
