"""Joining: offsets of a Doppler log's clock and heading to those of its vehicle's log.

The clock's offset is that at which both depths and both pitches agree best.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from factory.importing.deployment_log import DeploymentLog
from factory.importing.doppler.closure import ROBUST
from factory.importing.doppler.pd0 import Array, Ensembles
from twin.errors import InputError

REACH, COARSE, FINE = 3600.0, 5.0, 0.1
"""[s] REACH: largest offset of the clocks. COARSE, FINE: steps of the search."""
UNITS = {"depth": 1.0, "pitch": 3.0}
WORDS = {"depth": "depths by {:.1f} m", "pitch": "pitches by {:.1f} degree"}
"""UNITS: [m], [degree] differences that weigh the same. WORDS: texts of these differences."""
MOST, MOST_DEVIATIONS = 0.8, 1.2816
"""MOST: fraction of the samples that must agree; those in turns need not. MOST_DEVIATIONS: standard
deviations within which that fraction of normal errors lies."""
MOVES, CAPPED = 3.0, 25.0
"""MOVES: in UNITS, smallest standard deviation of a record that can be aligned. CAPPED: largest
square of a difference; turns are short, and the two logs sample them at other times."""
OVERLAP, PARTS = 0.5, 4
"""OVERLAP: smallest share of ensembles within the vehicle's log. PARTS: parts with own offsets."""
ALIKE, ALIKE_SHARE, TURNING = 1.0, 0.03, 15.0
"""Largest standard deviation between two records of one vehicle. ALIKE: in UNITS. ALIKE_SHARE: as a
share of their range, for sensors of unequal scale. TURNING: [degree] of headings."""
DEEPER, DEEPER_SHARE = 5.0, 0.1
"""Largest offset of the depths. DEEPER: [m]. DEEPER_SHARE: or as a share of their range."""


class Offsets(NamedTuple):
    """Offsets to be added to a Doppler log's values."""

    seconds: float
    """[s] Offset of the clock."""
    seconds_deviation: float
    """[s] Standard error of `seconds`, from the offsets of parts of the record."""
    heading: float
    """[degree] Offset of the heading; NaN without a heading."""
    heading_deviation: float
    """[degree] Standard deviation of the difference of headings at an ensemble."""


def find_offsets(name: str, layouts: Sequence[Ensembles], vehicle: DeploymentLog) -> Offsets:
    """Find the offsets of a file, `name` in errors.

    Raises:
      InputError: the records do not overlap, do not move enough to be aligned, or are those of two
        vehicles.
    """
    log = {n: np.concatenate([one[n] for one in layouts]) for n in ("time", "heading", *UNITS)}
    order = np.argsort(log["time"])
    order = order[np.isfinite(log["time"][order])]
    log = {n: values[order] for n, values in log.items()}
    time, (first, last) = log["time"], vehicle.span
    pairs = {
        n: (channel.time, channel.values / unit, log[n] / unit)
        for n, unit in UNITS.items()
        if len(channel := vehicle.channel(f"measured_{n}")) > 1
        and min(np.std(log[n]), np.std(channel.values)) > MOVES * unit
    }
    each = list(pairs.values())
    lags = np.arange(-REACH, REACH + COARSE, COARSE)
    apart = time[0] - REACH > last or time[-1] + REACH < first
    costs = np.full(len(lags), np.nan) if apart else _costs(lags, time, each)
    if pairs and not np.isfinite(costs).any():
        raise InputError(
            f"{name} does not overlap {vehicle.deployment}: it runs {_span(time[0], time[-1])}, "
            f"the log {_span(first, last)}. Was its clock never set? Give the log of the same dives"
        )
    if not pairs:
        raise InputError(
            f"{name} cannot be aligned with {vehicle.deployment}: neither depth nor pitch varies "
            f"in both by {MOVES * UNITS['depth']:g} m or {MOVES * UNITS['pitch']:g} degree"
        )
    seconds = _refined(float(lags[np.nanargmin(costs)]), time, each)
    parts = [
        _refined(seconds, time[part], [(t, v, own[part]) for t, v, own in each])
        for part in np.array_split(np.arange(len(time)), PARTS)
        if any(np.std(own[part]) > 1.0 for _, _, own in each)
    ]
    spread = float(np.std(parts, ddof=1)) / np.sqrt(len(parts)) if len(parts) > 1 else COARSE
    heading, turning = _heading_offset(time + seconds, log, vehicle)
    unlike = [f"headings by {turning:.0f} degree"] if turning > TURNING else []
    unlike += [text for n, pair in pairs.items() for text in _unlike(n, time + seconds, pair)]
    if unlike:
        raise InputError(
            f"{name} is not of {vehicle.deployment}: with its clock moved by {seconds:+.0f} s, "
            f"where both agree best, they differ: {', '.join(unlike)}. Give the Doppler log of "
            f"the same vehicle and dives, with a clock that is right to {REACH:g} s"
        )
    return Offsets(seconds, max(spread, FINE), heading, turning)


Pair = tuple[Array, Array, Array]
"""Times and values of the vehicle's log, and values of the Doppler log, in `UNITS`."""


def _unlike(name: str, at: Array, pair: Pair) -> list[str]:
    """Differences of depth or pitch beyond those of two sensors of one vehicle, as texts.

    Args:
      at: times [s] of the Doppler log by the vehicle's clock.
    """
    time, values, own = pair
    inside, reach = (at >= time[0]) & (at <= time[-1]), float(np.ptp(own))
    rest = np.interp(at[inside], time, values) - own[inside]
    middle = float(np.median(rest))
    found = []
    if name == "depth" and abs(middle) > max(DEEPER, DEEPER_SHARE * reach):
        found.append(f"depths by {abs(middle):.0f} m throughout")
    deviation = float(np.quantile(np.abs(rest - middle), MOST)) / MOST_DEVIATIONS
    if deviation > max(ALIKE, ALIKE_SHARE * reach):
        found.append(WORDS[name].format(deviation * UNITS[name]))
    return found


def _refined(start: float, time: Array, pairs: Sequence[Pair]) -> float:
    """Offset [s] in fine steps around a coarse one."""
    lags = start + np.arange(-2.0 * COARSE, 2.0 * COARSE + FINE, FINE)
    costs = _costs(lags, time, pairs)
    return float(lags[np.nanargmin(costs)]) if np.isfinite(costs).any() else start


def _costs(lags: Array, time: Array, pairs: Sequence[Pair]) -> Array:
    """Mean square of the differences at each offset; NaN without enough overlap.

    A constant difference costs nothing: sensors have offsets.
    """
    costs = np.zeros(len(lags))
    for k, lag in enumerate(lags):
        for own_time, values, own in pairs:
            at = time + lag
            inside = (at >= own_time[0]) & (at <= own_time[-1])
            if inside.mean() < OVERLAP:
                costs[k] = np.nan
                break
            difference = np.interp(at[inside], own_time, values) - own[inside]
            square = np.square(difference - np.median(difference))
            costs[k] += float(np.minimum(square, CAPPED).mean())
    return costs


def _heading_offset(time: Array, log: Ensembles, vehicle: DeploymentLog) -> tuple[float, float]:
    """Median difference [degree] of the headings and its spread; NaN where one has none."""
    own = vehicle.channel("measured_heading")
    inside = own.covers(time)
    if not inside.any() or np.ptp(log["heading"]) == 0.0:
        return np.nan, np.nan
    turned = np.interp(time, own.time, np.unwrap(own.values, period=360.0)) - log["heading"]
    turned = turned[inside]
    middle = np.angle(np.exp(1j * np.radians(turned)).mean(), deg=True)
    rest = (turned - middle + 180.0) % 360.0 - 180.0
    median = float(np.median(rest))
    spread = ROBUST * float(np.median(np.abs(rest - median)))
    return float((middle + median + 180.0) % 360.0 - 180.0), spread


def _span(start: float, end: float) -> str:
    """Start and end of a record in words."""
    words = (
        datetime.datetime.fromtimestamp(t, datetime.UTC).strftime("%Y-%m-%d %H:%M")
        for t in (start, end)
    )
    return "from {} to {}".format(*words)
