"""NGDAC profiles: the profile of each sample, and the current that each profile reports.

Here are also fixes, track and actuators of NGDAC files and of pyglider's time series.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import clean, positions
from factory.importing.deployment_log import NO_FIXES, Channel, LoggedFixes
from factory.importing.formats.slocum.native_sensors import gps_fixes
from factory.importing.netcdf import as_array, is_number
from factory.importing.tally import Tally, leave_out
from twin.geodesy import offset

Array = NDArray[np.float64]
Columns = dict[str, Array]
Number = NDArray[np.intp]

CURRENT = ("u", "v")
"""[m/s] Current of the segment, eastward and northward."""
STANDARD = {
    "pressure": "sea_water_pressure", "depth": "depth", "temperature": "sea_water_temperature",
    "salinity": "sea_water_practical_salinity",
    "conductivity": "sea_water_electrical_conductivity", "lat": "latitude", "lon": "longitude",
}  # fmt: skip
"""CF standard names of variables, by the names used here; other assemblies rename them."""
_NONE = -np.inf
"""Value in place of NaN where profiles are compared, as NaN differs from itself."""


def by_standard_name(variables: Mapping[str, Any], known: Collection[str]) -> dict[str, str]:
    """Map the names used here to a file's other names, by CF standard name. A standard name that
    several variables have is not mapped.

    Args:
      known: names that are read anyway, and not mapped.
    """
    found = {}
    for ours, standard in STANDARD.items():
        there = [
            name for name, variable in variables.items()
            if standard in (name, getattr(variable, "standard_name", ""))
        ]  # fmt: skip
        if ours not in variables and len(there) == 1 and there[0] not in known:
            found[ours] = there[0]
    return found


def profile_numbers(count: int, keys: Sequence[Array]) -> Number:
    """Index of each sample's profile, from 0; samples of one profile agree in all `keys`.

    Args:
      count: number of samples.
      keys: values that are constant within a profile, (samples,) each.
    """
    if not keys:
        return np.zeros(count, np.intp)
    table = np.stack([np.where(np.isnan(key), _NONE, key) for key in keys], axis=1)
    return np.unique(table, axis=0, return_inverse=True)[1].reshape(count)


def place_once(columns: Columns, pair: Sequence[str], when: Array, time: Array) -> None:
    """Keep a profile's position at one of its samples only, in place.

    Args:
      columns: with the two of the pair at each sample.
      when: [s] unix, time of the profile, (samples,); if NaN, the middle of its samples is used.
      time: [s] unix, of each sample.
    """
    values = [columns[name] for name in pair]
    number = profile_numbers(len(time), [*values, when])
    kept = np.zeros(len(time), bool)
    for one in np.unique(number):
        rows = np.flatnonzero((number == one) & np.isfinite(time))
        if rows.size:
            middle = when[rows[0]] if np.isfinite(when[rows[0]]) else float(np.median(time[rows]))
            kept[rows[np.argmin(np.abs(time[rows] - middle))]] = True
    for name, value in zip(pair, values, strict=True):
        columns[name] = np.where(kept, value, np.nan)


def currents_of(
    columns: Mapping[str, Array], number: Number, time: Array
) -> list[tuple[float, float, float]]:
    """End of each profile [s] unix, and its segment's current eastward and northward [m/s]; NaN
    without a current.

    Args:
      columns: at the samples, `u` and `v` among them where the file has them.
      number: profile of each sample.
      time: [s] unix, of each sample.
    """
    found = []
    unknown = np.full(len(time), np.nan)
    current = np.stack([columns.get(name, unknown) for name in CURRENT], axis=1)
    both = np.isfinite(current).all(axis=1)
    for one in np.unique(number):
        rows = np.flatnonzero((number == one) & np.isfinite(time))
        if rows.size:
            east, north = (
                current[rows[both[rows]][:1]].ravel() if both[rows].any() else (np.nan,) * 2
            )
            found.append((float(time[rows].max()), float(east), float(north)))
    return found


def reported_currents(
    profiles: Sequence[tuple[float, float, float]], fixes: LoggedFixes
) -> dict[str, Channel]:
    """Currents that the profiles report, each at its profile's end and the fixes until the next.

    A vehicle knows a dive's current only at the surface. The dive's row ends there: at the last
    sample of the profile, or at a later fix.

    Args:
      profiles: as in `currents_of`, of all files.
    """
    end, east, north = (np.array(part, np.float64) for part in zip(*sorted(profiles), strict=True))
    time = np.union1d(end, fixes.time[fixes.time > end[0]])
    at = np.searchsorted(end, time, side="right") - 1
    found = {"dac_east": east, "dac_north": north}
    return {n: c for n, v in found.items() if len(c := Channel.finite(time, v[at]))}


SERIES = "profile_index"
"""Variable of a time series of a whole deployment; profile files have `profile_id`."""

MAGNETIC = ("m_heading", "Heading")
"""Heading sensors of Slocums and SeaExplorers that are magnetic."""

SLOCUM = "m_"
"""Prefix of the names of a Slocum's sensors, whose angles are in radian."""

ACTUATORS = {
    "m_ballast_pumped": ("measured_pump", "cm3", "cm3", 1.0),
    "m_de_oil_vol": ("measured_pump", "cm3", "cm3", 1.0),
    "BallastPos": ("measured_pump", "cm3", "cm3", 1.0),
    "m_battpos": ("measured_shift", "m", "inch", 1.0),
    "LinPos": ("measured_shift", "m", "mm", 1.0),
    # the mass turns to starboard for positive angles, ours to port
    "AngPos": ("measured_rotation", "degree", "degree", -1.0),
}
"""By sensor: channel of the store, unit of the channel, unit of the sensor in a file that declares
none, and sign of the channel relative to the sensor."""

RECKONS = "DeadReckoning"
"""Sensor of a SeaExplorer: 1 where its position is dead-reckoned, 0 at a GPS fix."""

SURFACE = 2.0
"""[m] Depth above which a vehicle is at the surface, if its depth has no offset."""

UNDER_WATER = 5.0
"""[m] Depth below which no vehicle has a fix, whatever the offset of its depth."""

BENT = 0.05
"""[m] Distance from the straight line between its neighbours at which a position bends a track."""

MOST_BENT = 0.005
"""Largest fraction of positions under water that bend a track drawn through fixes. In pyglider's
own examples, none of the SeaExplorer's do, and 7 % of the Slocum's, which logs a position once a
minute."""


def sensor_columns(variables: Mapping[str, Any]) -> dict[str, str]:
    """Names of a file's variables, by the sensor of `ACTUATORS` (or `RECKONS`) behind them."""
    found: dict[str, str] = {}
    for name, variable in variables.items():
        sensor = str(getattr(variable, "source", name))
        if sensor not in (*ACTUATORS, RECKONS) or not is_number(variable):
            continue
        taken = variables.get(found.get(sensor, ""))
        if taken is None or not np.isfinite(as_array(taken[:])).any():
            found[sensor] = name
    return found


def actuators(
    time: Array, columns: Mapping[str, Array], sensors: Mapping[str, str], tally: Tally
) -> dict[str, Channel]:
    """Channels of pump and masses; of two pumps, the pump that moves more."""
    found: dict[str, tuple[float, str, Array]] = {}
    for sensor, name in sensors.items():
        values = columns.get(name)
        if sensor == RECKONS or values is None or not np.isfinite(values).any():
            continue
        channel, _, _, factor = ACTUATORS[sensor]
        one = float(np.nanmax(values) - np.nanmin(values)), name, factor * values
        if channel in found:
            fewer = min(one[:2], found[channel][:2])
            leave_out([fewer[1]], f"another variable gives {channel} and moves more", tally)
        if channel not in found or one[0] > found[channel][0]:
            found[channel] = one
    return {
        channel: clean(channel, time, values, tally, subject=name)
        for channel, (_, name, values) in found.items()
    }


def fixes_of_track(
    track: LoggedFixes, depth: Array, tally: Tally, *, reckons: Array | None = None
) -> tuple[LoggedFixes, bool]:
    """Fixes that a track goes through, and True if the track is straight lines between them.

    A track that less than MOST_BENT of its positions under water bend was drawn through the fixes.
    The positions at the surface that bend it are then the fixes. Any other track was dead-reckoned
    by the vehicle and reset at the surface; the last position before each dive is then a fix.

    Args:
      depth: [m] at the positions of the track, (samples,).
      reckons: above 0 where the vehicle dead-reckoned, 0 at a fix, (samples,). If both occur, the
        fixes come from it alone, and the track decides only about the straight lines.
    """
    if len(track) < 3:
        return NO_FIXES, False
    time, latitude, longitude = track.time, track.latitude, track.longitude
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
    tally.add("note", "GPS fixes", taken, why)
    return track.keep(taken), lines


TRACKS = (
    ("precise_lat", "precise_lon"), ("lat", "lon"), ("latitude", "longitude"),
    ("profile_lat", "profile_lon"),
)  # fmt: skip
"""Names of positions, the preferred first: from one for each sample to one for a profile."""

FIXES = ("m_gps_lat", "m_gps_lon", "m_gps_status")


def fixes_in(time: Array, columns: Mapping[str, Array], tally: Tally) -> LoggedFixes:
    """Select the vehicle's own GPS fixes; those with an invalid status are counted."""
    if not all(n in columns and np.isfinite(columns[n]).any() for n in FIXES[:2]):
        return NO_FIXES
    status = columns.get(FIXES[2], np.full(len(time), np.nan))
    return gps_fixes(time, columns[FIXES[0]], columns[FIXES[1]], status, tally=tally)


def track_in(time: Array, columns: Mapping[str, Array], tally: Tally) -> LoggedFixes:
    """Track that the file holds."""
    there = [pair for pair in TRACKS if all(n in columns for n in pair)]
    best = next((p for p in there if np.isfinite(columns[p[0]]).any()), None)
    if best is None:
        return NO_FIXES
    for pair in there:
        if pair != best:
            leave_out(pair, f"the track is {best[0]}, {best[1]}", tally)
    places = positions(columns[best[0]], columns[best[1]], ", ".join(best), tally)
    return LoggedFixes.finite(time, *places)
