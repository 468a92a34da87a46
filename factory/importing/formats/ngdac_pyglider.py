"""Pyglider: what its time series say beyond NGDAC's names.

Each variable names the vehicle's own sensor in its attribute `source`. Positions are straight lines
between the fixes (SeaExplorers), or the vehicle's dead reckoning (Slocums' `m_lat`, `m_lon`); the
fixes themselves are not kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import clean
from factory.importing.deployment_log import NO_FIXES, Channel, LoggedFixes
from factory.importing.netcdf import as_array
from factory.importing.tally import Tally, leave_out
from twin.geodesy import offset

Array = NDArray[np.float64]

SERIES = "profile_index"
"""Variable of a time series of a whole deployment; profile files have `profile_id`"""
MAGNETIC = ("m_heading", "Heading")
"""Sensors of Slocums and SeaExplorers whose heading is magnetic"""
SLOCUM = "m_"
"""How the names of a Slocum's sensors begin, whose angles are radian"""
ACTUATORS = {
    "m_ballast_pumped": ("measured_pump", "cm3", "cm3", 1.0),
    "m_de_oil_vol": ("measured_pump", "cm3", "cm3", 1.0),
    "BallastPos": ("measured_pump", "cm3", "cm3", 1.0),
    "m_battpos": ("measured_shift", "m", "inch", 1.0),
    "LinPos": ("measured_shift", "m", "mm", 1.0),
    # the mass turns to starboard for positive angles, ours to port
    "AngPos": ("measured_rotation", "degree", "degree", -1.0),
}
"""By the vehicle's sensor: channel of the store and its unit, the sensor's own unit where a file
declares none, and the sign"""
RECKONS = "DeadReckoning"
"""Sensor of a SeaExplorer: 1 where its position is reckoned, 0 at a GPS fix"""
SURFACE = 2.0
"""[m] shallower a vehicle is at the surface, if its depth has no offset"""
UNDER_WATER = 5.0
"""[m] deeper no vehicle has a fix, whatever the offset of its depth"""
BENT = 0.05
"""[m] from the straight line between its neighbours at which a position is one that bends it"""
MOST_BENT = 0.005
"""Part of the positions under water that may bend where a track was drawn through fixes. Of
pyglider's own examples none of the SeaExplorer's do, and 7 % of the Slocum's, which logs a position
once a minute."""


def sensor_columns(variables: Mapping[str, Any]) -> dict[str, str]:
    """Names of a file's variables by the sensor of `ACTUATORS`, or `RECKONS`, that they are of."""
    found: dict[str, str] = {}
    for name, variable in variables.items():
        sensor = str(getattr(variable, "source", name))
        numbers = variable.dtype != str and variable.dtype.kind in "fiu"
        if sensor not in (*ACTUATORS, RECKONS) or not numbers:
            continue
        if sensor not in found or not _has_values(variables[found[sensor]]):
            found[sensor] = name
    return found


def _has_values(variable: Any) -> bool:
    return bool(np.isfinite(as_array(variable[:])).any())


def actuators(
    time: Array, columns: Mapping[str, Array], sensors: Mapping[str, str], tally: Tally
) -> dict[str, Channel]:
    """Pump and masses; of two pumps the one that moves more."""
    found: dict[str, tuple[float, str, Array]] = {}
    for sensor, name in sensors.items():
        values = columns.get(name)
        if sensor == RECKONS or values is None or not np.isfinite(values).any():
            continue
        channel, _, _, factor = ACTUATORS[sensor]
        travel = float(np.nanmax(values) - np.nanmin(values))
        if channel in found:
            fewer = min((travel, name), found[channel][:2])
            leave_out([fewer[1]], f"another variable gives {channel} and moves more", tally)
        if channel not in found or travel > found[channel][0]:
            found[channel] = (travel, name, factor * values)
    return {
        channel: clean(channel, time, values, tally, subject=name)
        for channel, (_, name, values) in found.items()
    }


def fixes_of_track(
    time: Array,
    latitude: Array,
    longitude: Array,
    depth: Array,
    tally: Tally,
    *,
    reckons: Array | None = None,
) -> tuple[LoggedFixes, bool]:
    """The fixes that a track goes through, and whether it is lines between them.

    Where hardly a position under water bends the track it was drawn through the fixes: these are
    the positions at the surface that bend it. Else the vehicle reckoned, and set the track to a fix
    some time at the surface: the last position before each dive is taken for one.

    Args:
      time: [s] unix, increasing, (samples,).
      latitude, longitude: [degree], (samples,).
      depth: [m] at the same times, (samples,).
      reckons: above 0 where the vehicle says that it reckoned, 0 at a fix, (samples,): then that
        alone says what is a fix.
    """
    if len(time) < 3:
        return NO_FIXES, False
    metres = offset(latitude, longitude, float(latitude[0]), float(longitude[0]))
    share = np.diff(time)[:-1] / (time[2:] - time[:-2])
    bent = np.zeros(len(time), bool)
    bent[1:-1] = np.hypot(*(
        axis[1:-1] - axis[:-2] - share * (axis[2:] - axis[:-2]) for axis in metres
    )) > BENT  # fmt: skip
    under = depth > UNDER_WATER
    lines = not under.any() or float(bent[under].mean()) < MOST_BENT
    if reckons is not None and (reckons == 0.0).any() and (reckons > 0.0).any():
        moved = np.append(True, (np.diff(latitude) != 0.0) | (np.diff(longitude) != 0.0))
        taken, why = (reckons == 0.0) & moved, f"positions that are fixes by {RECKONS}"
    elif lines:
        taken, why = bent & ~under, "positions at the surface at which the file's track bends"
    else:
        taken = (depth < SURFACE) & np.append(depth[1:] >= SURFACE, False)
        why = "the track is reckoned: its last position before each dive"
    tally.add("note", "GPS fixes", int(taken.sum()), why)
    return LoggedFixes(time[taken], latitude[taken], longitude[taken]), lines
