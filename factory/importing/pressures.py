"""Pressures of a log: dbar below the surface, with their unit checked and the air's part removed.

A declared unit stands unless the file's own depth, the flight or the air at the surface contradict
it. If exactly one other unit fits, that unit is used and counted; else the log is suspect.

`zeroed` subtracts from the whole log the depth that a sensor shows at the surface.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import gsw
import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import clean, counts_upward, kelvin_to_celsius
from factory.importing.deployment_log import EMPTY, Channel, DeploymentLog
from factory.importing.gps_fixes import coasting, nearest
from factory.importing.plausibility import FASTEST, SLOWEST, DiveRules, speed_along_pitch
from factory.importing.tally import Tally
from factory.importing.units import factor_of, is_of
from twin.errors import InputError

_MS_PER_CM = 10.0
"""[mS/cm] in 1 S/m; gsw takes conductivity in mS/cm."""
_SWAPPED = 9.0
"""[S/m] Highest conductivity of sea water; a higher median is in mS/cm."""
_NONE, _DISTILLED = -0.01, 5e-4
"""[S/m] Range of a CTD that is off or in the air: less than any natural water conducts. Values
below the range are sentinels of the conductivity alone."""


def pressure_of(depth: Array, latitude_deg: Array | float) -> Array:
    """Sea pressure [dbar] at a depth [m].

    TEOS-10 ends 5 m above the sea. Higher up, where only a sensor's offset leads, pressure falls
    linearly.
    """
    below = np.maximum(depth, -_HIGHEST)
    pressure = gsw.p_from_z(-below, latitude_deg)
    if np.any(depth < -_HIGHEST):
        pressure = pressure + (depth - below) * gsw.p_from_z(-1.0, latitude_deg)
    return np.asarray(pressure, np.float64)


_HIGHEST = 4.0
"""[m] Height above the sea beyond which the pressure is linear."""


def siemens(conductivity: Array, subject: str, tally: Tally) -> Array:
    """Conductivity in S/m; values in mS/cm where S/m is native are converted, counted."""
    good = conductivity[np.isfinite(conductivity)]
    if good.size and np.median(good) > _SWAPPED:
        tally.add("repaired", subject, good.size, "was in mS/cm where S/m is native")
        return conductivity / _MS_PER_CM
    return conductivity


def ctd_channels(
    time: Array,
    *,
    temperature: Array,
    pressure: Array,
    latitude: Array | float,
    longitude: Array | float,
    tally: Tally,
    conductivity: Array | None = None,
    practical: Array | None = None,
) -> dict[str, Channel]:
    """Temperature, salinity and density as clean channels.

    Samples are left out where a sensor that they need has no value or an impossible one. A CTD that
    is off or in the air, by its conductivity, has no temperature either. If both are given,
    practical salinity is used, and conductivity [S/m] shows only when the CTD is off. Positions
    [degree] are one for all samples or one for each. A growing log needs one for each: earlier
    dives must not depend on later positions.
    """
    off = np.zeros(len(time), bool)
    if conductivity is not None:
        off |= (conductivity > _NONE) & (conductivity < _DISTILLED)
    if practical is not None:
        off |= (practical <= 0.0) & (temperature == 0.0)
    why = "the CTD is off or in the air"
    tally.add("removed", "temperature", off & np.isfinite(temperature), why)
    temperature = kelvin_to_celsius(np.where(off, np.nan, temperature), "temperature", tally)
    warm = clean("measured_temperature", time, temperature, tally, subject="temperature")
    if practical is not None:
        use = np.isin(time, warm.time)
        values = practical[use]
    elif conductivity is not None:
        conducts = clean("conductivity", time, conductivity, tally)
        use = np.isin(time, np.intersect1d(warm.time, conducts.time))
        with np.errstate(invalid="ignore"):
            values = gsw.SP_from_C(conductivity[use] * _MS_PER_CM, temperature[use], pressure[use])
    else:
        return {"measured_temperature": warm}
    fresh = clean("measured_salinity", time[use], np.asarray(values), tally, subject="salinity")
    use = np.isin(time, fresh.time)
    north, east = (np.broadcast_to(one, np.shape(time))[use] for one in (latitude, longitude))
    with np.errstate(invalid="ignore"):
        absolute = gsw.SA_from_SP(fresh.values, pressure[use], east, north)
        conservative = gsw.CT_from_t(absolute, temperature[use], pressure[use])
        dense = np.asarray(gsw.rho(absolute, conservative, pressure[use]), np.float64)
    channels = {
        "measured_temperature": warm,
        "measured_salinity": fresh,
        "measured_density": clean("measured_density", time[use], dense, tally, subject="density"),
    }
    return {name: channel for name, channel in channels.items() if len(channel)}


def with_depth(log: DeploymentLog, tally: Tally) -> DeploymentLog:
    """Add depth by TEOS-10 from the log's pressure; from depth alone, add pressure.

    A log whose rows are no dives may have neither.

    Raises:
      InputError: a log of dives has neither.
    """
    track = log.channel("latitude").values
    latitude = float(np.median(track)) if len(track) and not len(log.fixes) else log.fixes.middle[0]
    pressure, depth = log.channel("measured_pressure"), log.channel("measured_depth")
    made = {}
    if len(pressure):
        below = np.asarray(-gsw.z_from_p(pressure.values, latitude), np.float64)
        made["measured_depth"] = Channel(pressure.time, below)
    elif len(depth):
        made["measured_pressure"] = Channel(depth.time, pressure_of(depth.values, latitude))
        tally.add("note", "measured_pressure", len(depth), "computed from the vehicle's depth")
    elif log.pieces is None:
        raise InputError(f"{log.deployment}: the log has neither pressure nor depth")
    return dataclasses.replace(log, channels={**log.channels, **made})


Array = NDArray[np.float64]

AIR = 10.1325
"""[dbar] Standard pressure of the air at sea level."""
UNITS = ("dbar", "bar", "Pa", "kPa", "hPa", "MPa", "psi")
"""Units of pressures in logs."""
_FITS, _FAILS = 0.12, 0.25
"""A unit's misfit as a fraction of the depth. _FITS: largest that fits. _FAILS: it fails beyond."""
_DEEP = 5.0
"""[m] Depth above which the ratio of pressure to depth is not used."""
_FEWEST, _COMPARED = 10, 10_000
"""Number of samples that compare pressure with depth. _FEWEST: minimum. _COMPARED: of a long log"""
_MIDDLE = 45.0
"""[degree] Latitude at which pressure and depth are compared; the error at a pole is 0.3 %."""
_OFFSET = 5.0
"""[m] Smallest median difference of pressure and depth that is attributed to the air's pressure."""


def to_dbar(
    values: Array,
    depth: Array | None,
    subject: str,
    tally: Tally,
    *,
    native: str,
    declared: str = "",
    deployment: str = "",
) -> Array:
    """Pressure in dbar below the surface; the depth beside it shows its unit and the air's part.

    Args:
      values: in `native`.
      depth: [m] at the same samples.
      native: unit of the values: the format's own, or the unit that they were converted to.
      declared: unit that the file declares, for the report; a contradiction is then suspect.
      deployment: deployment of the values.

    Raises:
      InputError: pressure and depth fit no unit, and none is declared.
    """
    size = factor_of(native, "dbar")
    sure = is_of(declared, "dbar")
    if depth is None:
        return values * size
    if sure and factor_of(declared, "dbar") != size:
        values, native = values * (size / factor_of(declared, "dbar")), declared
        size = factor_of(declared, "dbar")
    some = np.flatnonzero(np.isfinite(values) & np.isfinite(depth) & (depth > _DEEP) & (values > 0))
    if len(some) < _FEWEST:
        return values * size
    some = some[:: max(1, len(some) // _COMPARED)]
    beside, middle = depth[some], float(np.median(depth[some]))

    def missed_by(unit: str, air: float) -> float:
        metres = np.asarray(-gsw.z_from_p(values[some] * factor_of(unit, "dbar") - air, _MIDDLE))
        return float(np.median(np.abs(metres - beside)))

    missed = {
        (unit, air): missed_by(unit, air)
        for unit in dict.fromkeys((native, *UNITS))
        for air in (0.0, AIR)
    }
    plain, absolute = missed[native, 0.0], missed[native, AIR]
    count = int(np.isfinite(values).sum())
    if min(plain, absolute) <= _FAILS * middle:
        if plain > _OFFSET and absolute < 0.3 * plain:
            tally.add("repaired", subject, count, "with the air's pressure in it, by the depth")
            return values * size - AIR
        return values * size
    unit, air = best = min(missed, key=lambda one: missed[one])
    if missed[best] <= _FITS * middle:
        why = f"was in {unit} where {native} is {'declared' if sure else 'native'}"
        tally.add("repaired", subject, count, why + (" and with the air's pressure" if air else ""))
        return values * factor_of(unit, "dbar") - air
    ratio = float(np.median(beside / values[some]))
    why = (
        f"pressure and depth do not belong together ({ratio:.3g} m for each unit of pressure; "
        f"{native} would be {size:g}); other vehicle's columns or unknown unit"
    )
    if not sure:
        raise InputError(f"{subject}: {why}")
    tally.doubt(subject, why, count, deployment=deployment)
    return values * size


def with_dbar_by_depth(
    channels: dict[str, Channel], tally: Tally, deployment: str
) -> dict[str, Channel]:
    """Check a declared pressure against the depth of the same log; correct it if a unit fits."""
    pressure, depth = (channels.get(n, EMPTY) for n in ("measured_pressure", "measured_depth"))
    if not len(pressure) or not len(depth):
        return channels
    values = to_dbar(
        pressure.values, depth.at(pressure.time), "measured_pressure", tally, native="dbar",
        declared="dbar", deployment=deployment,
    )  # fmt: skip
    return {**channels, "measured_pressure": Channel(pressure.time, values)}


def pressure_by_flight(pressure: Channel, pitch: Channel, subject: str, tally: Tally) -> Channel:
    """Correct a pressure [dbar] that the flight contradicts by a factor of ten; count it.

    Without a depth beside it, the speed by depth and pitch distinguishes bar from dbar.
    """
    speed = speed_along_pitch(pressure, pitch)
    for factor, unit in ((0.1, "dbar where bar"), (10.0, "bar where dbar")):
        wrong = speed > FASTEST if factor < 1.0 else speed < SLOWEST
        if wrong and SLOWEST < factor * speed < FASTEST:
            tally.add("repaired", subject, len(pressure), f"was in {unit} is native, by its speed")
            return Channel(pressure.time, pressure.values * factor)
    return pressure


def pressure_channels(
    time: Array,
    pressure: Array | None,
    depth: Array | None,
    subject: str,
    tally: Tally,
    *,
    pitch: Channel = EMPTY,
    depth_subject: str = "",
    declared: str = "",
    deployment: str = "",
) -> dict[str, Channel]:
    """Clean channel of the pressure, checked by depth or flight; without pressure, of the depth.

    Args:
      pressure: [dbar], depth: [m], (samples,) each.
      subject, depth_subject: names of the two variables, for the report.
      pitch: [degree], which shows the pressure's scale if there is no depth.
      declared, deployment: see `to_dbar`.
    """
    below = EMPTY
    if pressure is not None:
        dbar = to_dbar(
            pressure, depth, subject, tally, native="dbar", declared=declared, deployment=deployment
        )
        below = clean("measured_pressure", time, dbar, tally, subject=subject)
        if depth is None:
            below = pressure_by_flight(below, pitch, subject, tally)
    if depth is None or len(below):
        return {"measured_pressure": below} if len(below) else {}
    return {"measured_depth": clean("measured_depth", time, depth, tally, subject=depth_subject)}


_HIGHEST_LAKE = 0.5
"""Smallest absolute pressure at a water surface, as a fraction of that at sea level."""
_AT_SURFACE = 0.1
"""Largest fraction by which the air's pressure differs from sea level; higher lakes are rare."""
_FASTEST = 3.0
"""[dbar/s] Fastest change of a vehicle's pressure."""
_DEEPEST = 12_000.0
"""[dbar] Greatest pressure in the sea."""
_AFLOAT, _SEEN = 0.3, 0.2
"""[dbar] _AFLOAT: largest gauge pressure at the surface. _SEEN: smallest range of a dive."""


def without_air(
    time: Array, values: Array, unit: str, subject: str, tally: Tally, *, deployment: str = ""
) -> Array:
    """Subtract the air's pressure, in the declared unit; NaN if no unit is possible.

    Recordings begin or end at the surface, where an absolute pressure equals the air's. A lower
    pressure is in another unit, or excludes the air's pressure already.

    Args:
      time: [s] unix, (samples,).
      values: absolute pressure, as declared.
      unit: declared unit.
    """
    air = AIR / factor_of(unit, "dbar") if is_of(unit, "dbar") else np.nan
    good = np.isfinite(values)
    if not good.any() or not np.isfinite(air):
        return values - air
    low, high = (float(one) for one in np.percentile(values[good], [1.0, 99.0]))
    count, size = int(good.sum()), factor_of(unit, "dbar")
    if low >= _HIGHEST_LAKE * air or counts_upward((values - air) * size):
        return values - air  # `clean` negates a pressure that counts upward
    swum = {one: _can_dive(time[good], values[good] * factor_of(one, "dbar")) for one in UNITS}
    sizes = {one: factor_of(one, "dbar") for one in UNITS if swum[one]}
    absolute = [one for one, s in sizes.items() if abs(low * s - AIR) < _AT_SURFACE * AIR]
    gauge = [one for one, s in sizes.items() if abs(low * s) < _AFLOAT and (high - low) * s > _SEEN]
    if len(absolute) == 1:
        why = f"was in {absolute[0]} where {unit} is declared: by the air at the surface"
        tally.add("repaired", subject, count, why)
        return values * (sizes[absolute[0]] / size) - air
    if not absolute and len(gauge) == 1 and factor_of(gauge[0], "dbar") == size:
        tally.add("repaired", subject, count, "without the air's pressure: about 0 at the surface")
        return values
    tally.doubt(
        subject,
        f"{low:.3g} to {high:.3g} {unit} is less than the air's pressure: another unit, left out",
        count, deployment=deployment, start=float(time[good].min()), end=float(time[good].max()),
    )  # fmt: skip
    return np.full(len(values), np.nan)


def _can_dive(time: Array, dbar: Array) -> bool:
    """True if a vehicle can have been so deep and have changed its depth so fast."""
    _, first = np.unique(np.floor(time), return_index=True)  # noise looks fast in short steps
    rate = np.abs(np.diff(dbar[first]) / np.diff(time[first]))
    fast = float(np.percentile(rate, 99.0)) if rate.size else 0.0
    return bool(np.percentile(dbar, 99.0) < _DEEPEST and fast < _FASTEST)


_NEAR = 30.0
"""[s] Longest time between a fix and its depth sample."""

_PAUSE = 1800.0
"""[s] Longest time between two fixes of one surface interval."""

_STAY = 3
"""Minimum number of depths that give a surface interval's median."""
_SPREAD = 0.5
"""[m] Largest interquartile range of a surface interval, and largest step between two."""

_WINDOW = 5
"""Number of surface intervals in the running median of their depths."""

_PART = 0.5
"""Fraction of surface intervals that must agree before an offset is subtracted."""

_LEAST, _MOST = 0.5, 15.0
"""[m] Below _LEAST, offsets are waves and the antenna's height; above _MOST, another fault."""


class Stay(NamedTuple):
    """Surface interval of a log."""

    time: float
    """[s] Median time."""
    depth: float
    """[m] Median of the logged depth."""
    spread: float
    """[m] Interquartile range of the logged depth."""


def zeroed(log: DeploymentLog, rules: DiveRules, tally: Tally) -> DeploymentLog:
    """Subtract the depth sensor's zero error from depth and pressure; count it.

    A sensor that was never zeroed, or drifts, shows some metres while the vehicle floats. GPS fixes
    or the vehicle's own state show its surface intervals. If their median depths agree, straight
    lines between them are subtracted.

    Args:
      log: with `measured_depth`; `afloat` holds times at which the vehicle reports that it floats.
    """
    depth = log.channel("measured_depth")
    every = [] if log.station or not len(depth) else stays(log, depth, rules)
    if not every:
        return log
    times, shown, spread = (np.array(one) for one in zip(*every, strict=True))
    if len(shown) > 1 and np.median(np.abs(np.diff(shown))) > _SPREAD:
        return log
    half = _WINDOW // 2
    around = [np.median(shown[max(0, k - half) : k + half + 1]) for k in range(len(shown))]
    agree = (spread <= _SPREAD) & (np.abs(shown - np.array(around)) <= _SPREAD)
    if agree.mean() <= _PART:
        return log
    offsets = shown[agree]
    middle = float(np.median(offsets))
    if not _LEAST <= abs(middle) <= _MOST:
        return log
    corrected = depth.values - np.interp(depth.time, times[agree], offsets)
    low, high = float(offsets.min()), float(offsets.max())
    size = f"{middle:.2f} m" if high - low < 0.1 else f"{low:.2f} to {high:.2f} m"
    why = f"{log.deployment}: depth offset {size} at the surface, taken off"
    tally.add("repaired", "measured_depth", len(depth), why)
    pressure = pressure_of(corrected, log.fixes.middle[0])
    channels = {
        **log.channels,
        "measured_depth": Channel(depth.time, corrected),
        "measured_pressure": Channel(depth.time, pressure),
    }
    return dataclasses.replace(log, channels=channels)


def stays(log: DeploymentLog, depth: Channel, rules: DiveRules) -> list[Stay]:
    """Surface intervals with enough depths, in time order."""
    fixes = log.fixes.keep(~coasting(log.fixes, rules.coast_speed))
    times = np.unique(np.concatenate([fixes.time, log.channel("afloat").time]))
    at = nearest(depth.time, times)
    times = np.unique(at[np.abs(at - times) <= _NEAR])
    index = np.searchsorted(depth.time, times)
    shown = depth.values[index]
    breaks = [
        k + 1
        for k in range(len(times) - 1)
        if times[k + 1] - times[k] > _PAUSE
        or depth.values[index[k] : index[k + 1] + 1].max()
        > max(shown[k], shown[k + 1]) + rules.min_depth
    ]
    found = []
    for part in np.split(np.arange(len(times)), breaks):
        if len(part) >= _STAY:
            low, high = np.percentile(shown[part], [25.0, 75.0])
            middle, depth_then = (float(np.median(one[part])) for one in (times, shown))
            found.append(Stay(middle, depth_then, float(high - low)))
    return found


def used_of_left(left: Channel) -> Channel:
    """Charge used [A h], by a counter of the charge left [A h]: 0 at its first sample."""
    return Channel(left.time, left.values[:1] - left.values) if len(left) else left


SEA_LEVEL = 101_325.0
"""[Pa] Standard pressure of the air, from which a vacuum counts."""
