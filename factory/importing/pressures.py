"""Pressure of a log in dbar below the surface: its unit, and the air's part of it.

A declared unit stands unless the file's own depth, the flight or the air at the surface contradict
it and fit one other unit; that one is taken and counted. What fits none is suspect.
"""

from __future__ import annotations

import gsw
import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import counts_upward
from factory.importing.deployment_log import EMPTY, Channel
from factory.importing.plausibility import FASTEST, SLOWEST, speed_along_pitch
from factory.importing.tally import Tally
from factory.importing.units import factor_of, is_of
from twin.errors import InputError

Array = NDArray[np.float64]

AIR = 10.1325
"""[dbar] Standard pressure of the air at sea level"""
UNITS = ("dbar", "bar", "Pa", "kPa", "hPa", "MPa", "psi")
"""What pressures of logs are in"""
_FITS, _FAILS = 0.12, 0.25
"""Part of the depth by which a unit may miss it, and from which it contradicts it."""
_DEEP = 5.0
"""[m] Shallower, the ratio of pressure to depth says nothing."""
_FEWEST, _COMPARED = 10, 10_000
"""Samples that compare pressure and depth: at least, and about how many of a long log."""
_MIDDLE = 45.0
"""[degree] Latitude at which pressure and depth are compared: 0.3 % off at a pole"""
_OFFSET = 5.0
"""[m] Least median distance of pressure from depth that the air can be the cause of"""


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
    """Pressure in dbar below the surface; the depth beside it tells its unit and the air's part.

    Args:
      values: in `native`.
      depth: [m] at the same samples.
      native: unit of the values: that of the format, or what they have been converted to.
      declared: unit that the file declares, for the report: then a contradiction is suspect.
      deployment: that the values are of.

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
    use = np.isfinite(values) & np.isfinite(depth) & (depth > _DEEP) & (values > 0.0)
    if use.sum() < _FEWEST:
        return values * size
    some = np.flatnonzero(use)
    some = some[:: max(1, len(some) // _COMPARED)]
    beside, middle = depth[some], float(np.median(depth[some]))
    units = dict.fromkeys((native, *UNITS))
    missed = {
        (unit, air): float(
            np.median(np.abs(_metres(values[some] * factor_of(unit, "dbar") - air) - beside))
        )
        for unit in units
        for air in (0.0, AIR)
    }
    plain, absolute = missed[native, 0.0], missed[native, AIR]
    best = min(missed, key=lambda one: missed[one])
    count = int(np.isfinite(values).sum())
    if min(plain, absolute) <= _FAILS * middle:
        if plain > _OFFSET and absolute < 0.3 * plain:
            tally.add("repaired", subject, count, "with the air's pressure in it, by the depth")
            return values * size - AIR
        return values * size
    unit, air = best
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
    """Channels of a log that declares its units, the pressure as the depth beside it allows."""
    pressure, depth = (channels.get(n, EMPTY) for n in ("measured_pressure", "measured_depth"))
    if not len(pressure) or not len(depth):
        return channels
    values = to_dbar(
        pressure.values, depth.at(pressure.time), "measured_pressure", tally, native="dbar",
        declared="dbar", deployment=deployment,
    )  # fmt: skip
    return {**channels, "measured_pressure": Channel(pressure.time, values)}


def _metres(dbar: Array) -> Array:
    return np.asarray(-gsw.z_from_p(dbar, _MIDDLE), np.float64)


def pressure_by_flight(pressure: Channel, pitch: Channel, subject: str, tally: Tally) -> Channel:
    """Pressure [dbar] whose scale the flight contradicts by a factor of ten, corrected; counted.

    Without a depth beside it, bar and dbar are told apart by the speed that depth and pitch give.
    """
    speed = speed_along_pitch(pressure, pitch)
    for factor, unit in ((0.1, "dbar where bar"), (10.0, "bar where dbar")):
        wrong = speed > FASTEST if factor < 1.0 else speed < SLOWEST
        if wrong and SLOWEST < factor * speed < FASTEST:
            tally.add("repaired", subject, len(pressure), f"was in {unit} is native, by its speed")
            return Channel(pressure.time, pressure.values * factor)
    return pressure


_HIGHEST_LAKE = 0.5
"""Part of the air's pressure at sea level below which no water has a surface"""
_AT_SURFACE = 0.1
"""Part by which the air's pressure differs from that at sea level; higher lakes are rare"""
_FASTEST = 3.0
"""[dbar/s] No vehicle changes its pressure faster"""
_DEEPEST = 12_000.0
"""[dbar] of the sea"""
_AFLOAT, _SEEN = 0.3, 0.2
"""[dbar] What a pressure without the air's may show at the surface; and a range that is a dive"""


def without_air(
    time: Array, values: Array, unit: str, subject: str, tally: Tally, *, deployment: str = ""
) -> Array:
    """Pressure less the air's, in the unit that is declared; NaN where no unit can be meant.

    Recordings begin or end at the surface, where an absolute pressure is the air's. One that is
    lower than any air's is in another unit, or has none of it.

    Args:
      time: [s] unix, (samples,).
      values: absolute pressure, as declared.
      unit: that it is declared in.
    """
    air = AIR / factor_of(unit, "dbar") if is_of(unit, "dbar") else np.nan
    good = np.isfinite(values)
    if not good.any() or not np.isfinite(air):
        return values - air
    low, high = (float(one) for one in np.percentile(values[good], [1.0, 99.0]))
    count, size = int(good.sum()), factor_of(unit, "dbar")
    if low >= _HIGHEST_LAKE * air or counts_upward((values - air) * size):
        return values - air  # whoever cleans it turns what counts upward
    swum = {one: _is_swum(time[good], values[good] * factor_of(one, "dbar")) for one in UNITS}
    sizes = {one: factor_of(one, "dbar") for one in UNITS if swum[one]}
    absolute = [one for one, s in sizes.items() if abs(low * s - AIR) < _AT_SURFACE * AIR]
    gauge = [
        one for one, s in sizes.items() if abs(low * s) < _AFLOAT and (high - low) * s > _SEEN
    ]  # fmt: skip
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


def _is_swum(time: Array, dbar: Array) -> bool:
    """Whether a vehicle can have been so deep and have come there so fast."""
    _, first = np.unique(np.floor(time), return_index=True)  # noise is fast between near samples
    rate = np.abs(np.diff(dbar[first]) / np.diff(time[first]))
    fast = float(np.percentile(rate, 99.0)) if rate.size else 0.0
    return bool(np.percentile(dbar, 99.0) < _DEEPEST and fast < _FASTEST)
