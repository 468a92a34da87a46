"""GPS fixes: impossible ones, such as fixes under water, are removed and counted.

Columns of a receiver show whether it has a fix: quality, dilution of precision, satellites.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import Channel, DeploymentLog, LoggedFixes
from factory.importing.plausibility import DiveRules, runs
from factory.importing.tally import Tally
from twin.geodesy import offset

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FIXES = "GPS fixes"
"""Report subject of fixes; the number read is the sum of those kept, removed and left out."""
STATION_DEPTH = 8.0
"""[m] Depth beyond which a fix is wrong even with rare depths, or paired by a shore station."""
_STEPS = 3
"""Minimum number of equal steps, faster than any drift, that show extrapolated positions."""
_ALIKE = 0.3
"""Fraction by which velocities that count as equal may differ."""
_LONGEST_STEP = 60.0
"""[s] Longest step of a receiver's extrapolation."""
_NEAR = 120.0
"""[s] Longest time between a fix and the depth by which it is judged."""
_SHARE, _LEAST = 0.5, 5
"""With at least _LEAST fixes under water, and more than _SHARE of all, the clocks are suspect."""
_QUARTER, _SHIFTS = 900.0, 96
"""_QUARTER: [s] step of the clock differences tried. _SHIFTS: number of steps to either side."""
_FITS = 0.9
"""Fraction of the fixes that a clock difference must bring to the surface to be reported."""
QUALITIES = ("quality", "fix_quality", "gps_quality")
"""Columns with the fix quality of NMEA 0183's GGA."""
MEASURED = (1.0, 2.0, 3.0, 4.0, 5.0, 9.0)
"""Qualities of a measured fix; 0 is none, 6 dead reckoning, 7 put in by hand, 8 simulated."""
DILUTIONS = ("hdop", "gps_hdop")
NO_DILUTION = 99.0
"""Dilution of precision of a receiver without a fix, which may also write 99.9."""
SATELLITES = ("satellites", "num_satellites", "n_satellites", "numberofsatellites", "nsat", "nsats")
FEWEST_SATELLITES = 3.0
"""Minimum number of satellites for a fix at sea level."""
RECEIVER = (*QUALITIES, *DILUTIONS, *SATELLITES)
"""Receiver columns that are read, in small letters."""


def has_fix(columns: Mapping[str, Array], count: int) -> Mask:
    """True where the receiver's columns show a fix, (count,)."""
    fixed = np.ones(count, bool)
    for name, values in columns.items():
        word = name.lower()
        says = ~np.isfinite(values)
        if word in QUALITIES:
            says |= np.isin(values, MEASURED)
        elif word in DILUTIONS:
            says |= values < NO_DILUTION
        elif word in SATELLITES and (values >= FEWEST_SATELLITES).any():
            says |= values >= FEWEST_SATELLITES  # a vehicle that does not count them writes 0
        else:
            continue
        fixed &= says
    return fixed


def good_fixes(
    fixes: LoggedFixes, depth: Channel, rules: DiveRules, tally: Tally, *, station: bool = False
) -> LoggedFixes:
    """Remove fixes that a receiver invents and fixes that no drift explains; count them.

    Args:
      depth: [m] below the log's own surface.
      station: a shore station has paired the fixes with the dives.
    """
    if not len(fixes):
        return fixes
    racing = coasting(fixes, rules.coast_speed)
    tally.add(
        "removed", FIXES, racing,
        f"constant velocity above {rules.coast_speed:g} m/s: the receiver coasts, or is carried",
    )  # fmt: skip
    fixes = fixes.keep(~racing)
    if station:
        near = np.abs(nearest(depth.time, fixes.time) - fixes.time) < _NEAR
        deep = (depth.at(fixes.time) > STATION_DEPTH) & near
        tally.add("removed", FIXES, deep, f"deeper than {STATION_DEPTH:g} m")
        fixes = fixes.keep(~deep)
    elif len(depth):
        fixes = _surfaced(fixes, depth, rules, tally)
    keep = np.ones(len(fixes), bool)
    for i in range(1, len(fixes) - 1):
        # away from both neighbours, while these agree with each other
        if _is_far(fixes, i - 1, i, rules) and _is_far(fixes, i, i + 1, rules):
            keep[i] = _is_far(fixes, i - 1, i + 1, rules)
    tally.add("removed", FIXES, ~keep, "away from their neighbours")
    return fixes.keep(keep)


def tell_read(logs: Sequence[DeploymentLog], tally: Tally) -> None:
    """Count the fixes in the files: those of the logs, and those that the reader removed."""
    before = sum(
        entry.count
        for entry in tally.entries()
        if entry.subject == FIXES and entry.action in ("removed", "left out")
    )
    tally.add("read", FIXES, before + sum(len(log.fixes) for log in logs), "with a position")


def tell_fixes(fixes: LoggedFixes, used: Mask, tally: Tally, *, kept: str, left_out: str) -> None:
    """Count the good fixes that rows use and those that no row uses."""
    tally.add("kept", FIXES, used, kept)
    tally.add("left out", FIXES, ~used, left_out)


def coasting(fixes: LoggedFixes, fastest: float) -> Mask:
    """True for fixes of a receiver that lost its satellites and continues at its last velocity.

    Such fixes make at least `_STEPS` steps at one velocity, above `fastest` [m/s].
    """
    bad = np.zeros(len(fixes), bool)
    if len(fixes) <= _STEPS:
        return bad
    gap = np.diff(fixes.time)
    velocity = np.array([complex(*_offset(fixes, i, i + 1)) for i in range(len(gap))])
    velocity = velocity / np.maximum(gap, 1e-3)
    fast = (np.abs(velocity) > fastest) & (gap < _LONGEST_STEP)
    alike = fast[1:] & fast[:-1]
    alike &= np.abs(np.diff(velocity)) < _ALIKE * np.maximum(np.abs(velocity[1:]), fastest)
    for start, end in runs(alike):  # n similar pairs are n + 1 steps
        if end - start + 1 >= _STEPS:
            bad[start + 1 : end + 2] = True
    return bad


def _surfaced(fixes: LoggedFixes, depth: Channel, rules: DiveRules, tally: Tally) -> LoggedFixes:
    """Keep fixes at the surface, and fixes just below it if the receiver has hardly coasted yet."""
    away = np.abs(nearest(depth.time, fixes.time) - fixes.time)
    right = np.clip(np.searchsorted(depth.time, fixes.time), 0, len(depth) - 1)
    left = np.maximum(right - 1, 0)
    least = np.minimum(depth.values[left], depth.values[right])
    # a fix in a gap of the depths counts as deep only if both sides are well below
    near = (away < rules.fix_lag) | ((away < _NEAR) & (least > STATION_DEPTH))
    # with rare depths one shallow neighbour is enough
    rare = depth.time[right] - depth.time[left] > rules.fix_lag
    shallow = depth.at(fixes.time) <= rules.fix_depth
    deep = near & ~(shallow | (rare & (least <= rules.fix_depth)))
    keep = ~deep
    coasted, last = 0, -1
    for i in range(len(fixes)):
        if not deep[i]:
            last = i
        elif rules.coast > 0.0 and _just_dived(float(fixes.time[i]), depth, rules):
            known = last >= 0 and fixes.time[i] - fixes.time[last] < _LONGEST_STEP
            keep[i] = (_distance(fixes, last, i) if known else 0.0) <= rules.coast
            coasted += int(keep[i])
    wet = int((~keep).sum())
    if wet > _SHARE * near.sum() and wet >= _LEAST:
        tally.doubt(FIXES, _clock_doubt(fixes.time, depth, rules), wet)
    deeper = f"deeper than {rules.fix_depth:g} m"
    tally.add("removed", FIXES, wet, f"under water: {deeper}")
    tally.add(
        "note", FIXES, coasted, f"{deeper}, within {rules.fix_lag:g} s of the surface and"
        f" {rules.coast:g} m of the last one there: kept",
    )  # fmt: skip
    return fixes.keep(keep)


def _just_dived(time: float, depth: Channel, rules: DiveRules) -> bool:
    before = depth.within(time - rules.fix_lag, time)
    if not len(before) or before.time[0] == time:  # the log begins with the fix
        return bool(depth.at(np.array([time]))[0] <= STATION_DEPTH)
    return bool(before.values.min() <= rules.fix_depth)


def _clock_doubt(times: Array, depth: Channel, rules: DiveRules) -> str:
    """Text for the report, with the clock difference that brings fixes to the surface."""
    best, found = 0.0, 0.0
    for k in range(-_SHIFTS, _SHIFTS + 1):
        moved = times + k * _QUARTER
        inside = (moved >= depth.time[0]) & (moved <= depth.time[-1])
        if inside.sum() < 0.5 * len(times):
            continue
        share = float(np.mean(depth.at(moved[inside]) <= rules.fix_depth))
        # among equal shifts, keep the smallest
        if share > found + 1e-9 or (share == found and abs(k * _QUARTER) < abs(best)):
            best, found = k * _QUARTER, share
    text = "most fixes are under water: do the clocks of GPS and flight differ?"
    if found >= _FITS and best:
        text += f" Fixes {abs(best) / 3600.0:g} h {'later' if best > 0 else 'earlier'} would fit"
    return text


def _offset(fixes: LoggedFixes, i: int, j: int) -> tuple[Array, Array]:
    """[m] North and east distance from fix `i` to fix `j`."""
    start = float(fixes.latitude[i]), float(fixes.longitude[i])
    return offset(fixes.latitude[j], fixes.longitude[j], *start)


def _distance(fixes: LoggedFixes, i: int, j: int) -> float:
    """[m] Distance between fixes `i` and `j`."""
    return float(np.hypot(*_offset(fixes, i, j)))


def _is_far(fixes: LoggedFixes, i: int, j: int, rules: DiveRules) -> bool:
    reach = rules.fix_noise + rules.fix_speed * float(fixes.time[j] - fixes.time[i])
    return _distance(fixes, i, j) > reach


def nearest(times: Array, wanted: Array) -> Array:
    """Nearest of `times` to each wanted time; infinite if `times` is empty."""
    if not len(times):
        return np.full(np.shape(wanted), np.inf)
    right = np.clip(np.searchsorted(times, wanted), 1, max(len(times) - 1, 1))
    right = np.minimum(right, len(times) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(wanted - times[left] <= times[right] - wanted, times[left], times[right])
