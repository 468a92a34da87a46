"""Dive checks: incomplete logs, stuck sensors, and values that no ocean and no vehicle allows.

`since_clock` removes samples that a log holds from before its clock was set.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import EMPTY, TRUNCATED, Array, Channel, DeploymentLog
from factory.importing.dives.segments import CLIMB, DESCENT, LogSegment
from factory.importing.plausibility import DiveRules, runs
from factory.importing.sample_clock import AHEAD
from factory.importing.tally import Tally
from twin.records.coordinates import utc_minute
from twin.records.logged import DRIVEN
from twin.records.schema.limits import depth_faults, recorded_limits

_SILENT = 120.0
"""[s] Longest time from a fix to a depth; a Seaglider needs a minute or two for its first fix."""
_DEEP = 10.0
"""[m] Greatest depth from which a vehicle can surface within that time."""
_BELOW = 5.0
"""[m] Depth below which sensors are judged."""
_FEWEST = 20
"""Minimum number of samples that show a stuck sensor."""
_STEADY = ("measured_pitch", "measured_heading")
"""Channels that always vary over a dive, if only in the last digit."""
_STANDS, _PITCHED = 300.0, 10.0
"""_STANDS: [s] longest time at one depth with the nose up or down by _PITCHED [degree]."""


def since_clock(log: DeploymentLog, rules: DiveRules, tally: Tally) -> DeploymentLog:
    """Remove samples from before the log's clock was set; count them.

    Such a stretch ends with a silence of more than `_UNSET`, and holds neither a fix, which would
    have set the clock, nor a dive.
    """
    if log.pieces is not None or log.gridded:
        return log
    times, last = np.unique(log.fixes.time), log.fixes.time
    for one in {**log.channels, **log.auxiliary}.values():  # many channels share one clock
        if not np.array_equal(one.time, last):
            times, last = np.union1d(times, one.time), one.time
    begins = np.concatenate([[-np.inf], times[1:][np.diff(times) > _UNSET]])
    deep = log.channel("measured_depth") or log.channel("measured_pressure")
    known = np.concatenate([log.fixes.time, deep.time[deep.values > rules.min_depth]])
    if len(begins) == 1 or not known.size:
        return log
    start = float(begins[np.searchsorted(begins, known.min(), side="right") - 1])
    lost = times[times < start]
    if not lost.size:
        return log
    day = datetime.datetime.fromtimestamp(float(lost[0]), datetime.UTC).date()
    tally.add("removed", log.deployment, lost.size, f"times from before the clock was set: {day}")

    def later(channels: Mapping[str, Channel]) -> dict[str, Channel]:
        return {n: kept for n, one in channels.items() if len(kept := one.within(start, np.inf))}

    variation = log.magnetic_variation
    return dataclasses.replace(
        log, channels=later(log.channels), auxiliary=later(log.auxiliary),
        magnetic_variation=variation.within(start, np.inf) or variation,
    )  # fmt: skip


_UNSET = 30.0 * 86400.0
"""[s] A longer silence shows that the clock was set; deployments are silent for days at most."""


def tell_above_sea(log: DeploymentLog, tally: Tally) -> None:
    """Mark a log as suspect if depths lie above the sea: its sensor has an offset, and no surface
    interval shows it."""
    depth = log.channel("measured_depth")
    high = depth.values < -_ABOVE_SEA
    if high.any():
        tally.doubt(
            "measured_depth", f"above the sea by up to {-depth.values.min():.1f} m: the sensor has "
            "an offset, and no GPS fix or state at the surface tells it",
            high, deployment=log.deployment,
        )  # fmt: skip


_ABOVE_SEA = 5.0
"""[m] Height above the sea that no wave reaches."""


def complete(log: DeploymentLog, segment: LogSegment, tally: Tally) -> bool:
    """Check that the log covers a dive from its first fix to its last; report missing parts."""
    inside = log.channel("measured_depth").within(segment.start, segment.end)
    if not len(inside):
        return False
    whole = True
    for at, fix, silent, word in (
        (-1, segment.end_fix, segment.end - inside.time[-1], "ends"),
        (0, segment.start_fix, inside.time[0] - segment.start, "begins"),
    ):
        if fix is not None and inside.values[at] > _DEEP and silent > _SILENT:
            tally.add(
                "note", "incomplete dives", 1,
                f"{log.deployment} dive of {utc_minute(round(segment.start))}: log {word} at "
                f"{inside.values[at]:.0f} m",
            )  # fmt: skip
            whole = False
    return whole


def tell_silent(log: DeploymentLog, segment: LogSegment, tally: Tally) -> None:
    """Report a flight log that ends while the depth goes on: a file is cut or missing."""
    shown = computer_of(log, segment)
    depth = log.channel("measured_depth").within(segment.start, segment.end)
    below = depth.time[depth.values > _BELOW]
    if not len(shown):
        return
    silent = below[~shown.covers(below)]
    for part in np.split(silent, np.flatnonzero(np.diff(silent) > _SILENT) + 1):
        if not len(part) or part[-1] - part[0] <= _SILENT:
            continue
        before = shown.time[shown.time <= part[0]]
        if before.size:
            edge, minutes, words = before[-1], part[-1] - before[-1], ("ends", "goes on")
        else:
            edge, minutes, words = shown.time[0], shown.time[0] - part[0], ("begins", "before it")
        tally.add(
            "note", log.deployment, 1,
            f"{TRUNCATED}the flight log {words[0]} at {utc_minute(edge)} UTC under water, and the "
            f"depth {words[1]} for {minutes / 60.0:.0f} min without attitude, actuators and "
            "commands: a flight file was cut off, or is missing",
        )  # fmt: skip


def standing(log: DeploymentLog, segment: LogSegment, tally: Tally) -> None:
    """Report sensors that were stuck for a whole dive as `suspect`, once for each dive."""
    depth = log.channel("measured_depth").within(segment.start, segment.end)
    below = depth.values > _BELOW
    if below.sum() < _FEWEST:
        return
    stuck = {}
    for name in _STEADY:
        values = log.channel(name).within(*depth.time[below][[0, -1]]).values
        if len(values) >= _FEWEST and np.ptp(values) == 0.0:
            stuck[name] = "the same value for a whole dive"
    pitch = log.channel("measured_pitch")
    if len(pitch):
        same = (np.diff(depth.values) == 0.0) & below[1:]
        same &= np.abs(pitch.known(depth.time[1:])) > _PITCHED
        if max((depth.time[end] - depth.time[start] for start, end in runs(same)), default=0.0) > (
            _STANDS
        ):
            stuck["measured_depth"] = f"one depth for more than {_STANDS:g} s while pitched"
    for name, why in stuck.items():
        tally.add("suspect", name, 1, f"{log.deployment}: {why}; stuck? (dives counted)")


Reason = tuple[str, str]
"""Channel, and its fault in words."""


def keep_possible(signals: dict[str, Array]) -> list[Reason]:
    """Replace values that no store may hold by NaN, in place; return the faults.

    Channels of a log are within limits already. Signals derived from them may not be, such as
    tracks and times of samples.

    Args:
      signals: of the row, (time,) each.
    """
    found: list[Reason] = []
    for name, values in signals.items():
        low, high = recorded_limits(name)
        bad = (values < low) | (values > high)
        if bad.any():
            signals[name] = np.where(bad, np.nan, values)
            found.append((name, f"outside {low:g} to {high:g}: removed"))
    return found


STRONGEST_CURRENT = 3.0
"""[m/s] Largest current averaged over a dive: the core of the Gulf Stream has 2.5."""
FASTEST_OVER_GROUND = 6.0
"""[m/s] Largest speed over ground: the fastest vehicles swim 3 m/s, a current adds as much."""
FARTHEST = 1e6
"""[m] Largest plausible distance of a waypoint or a track from the row's start."""
_ELSEWHERE = {"commanded_waypoint": "its waypoint", "measured_onboard": "its own track"}
_NOTHING = np.zeros(0)
FLAT, FALLS = 2.0, 0.14
"""[degree, m/s] A hull pitched by less than `FLAT` sinks more slowly than `FALLS`: 0.5 kg of net
mass over 0.5 m2 of its side and a drag coefficient of 1 give 0.13 m/s."""


def doubts_of(
    log: DeploymentLog,
    segment: LogSegment,
    signals: Mapping[str, Array],
    numbers: Mapping[str, float],
    period: float,
) -> list[Reason]:
    """Find values of a dive that no ocean and no vehicle allows.

    Args:
      signals: of the row, on its grid, (time,) each.
      numbers: of the row, such as its currents.
      period: [s] sampling interval of the grid.
    """
    found: list[Reason] = []
    if not log.simulated and segment.end > datetime.datetime.now(datetime.UTC).timestamp() + AHEAD:
        found.append(("time", "later than this computer's clock; another unit, or a wrong clock?"))
    depth, pressure = signals.get("measured_depth"), signals.get("measured_pressure")
    if depth is not None:
        found += [("measured_depth", why) for why, _ in depth_faults(depth, pressure, period)]
    for whose in ("vehicle_dac", "dac"):
        speed = math.hypot(*(numbers.get(f"{whose}_{axis}", 0.0) for axis in ("north", "east")))
        if speed > STRONGEST_CURRENT:
            found.append((whose, f"a current of more than {STRONGEST_CURRENT:g} m/s"))
    if math.hypot(*segment.displacement) > FASTEST_OVER_GROUND * segment.duration:
        why = f"faster over ground than {FASTEST_OVER_GROUND:g} m/s between its fixes"
        found.append(("GPS fixes", why))
    for name, what in _ELSEWHERE.items():
        away = np.hypot(*(signals.get(f"{name}_{axis}", _NOTHING) for axis in ("north", "east")))
        known = away[np.isfinite(away)]
        if known.size and np.median(known) > FARTHEST:
            why = f"more than {FARTHEST / 1e3:g} km from {what}; minutes for degrees?"
            found.append(("GPS fixes", why))
    if log.pieces is None and numbers.get("thruster_fraction", 0.0) <= DRIVEN:
        found += _pitch_fault(signals, period)
    return found


def _pitch_fault(signals: Mapping[str, Array], period: float) -> list[Reason]:
    """Fault of a glide whose pitch is too small for its vertical velocity."""
    needed = ("measured_depth", "measured_pitch", "measured_gap", "measured_phase")
    if any(name not in signals for name in needed):
        return []
    depth, pitch, gap, phase = (signals[name] for name in needed)
    glide = (gap < 0.5) & (depth > _BELOW) & np.isin(phase, (DESCENT, CLIMB)) & np.isfinite(pitch)
    if glide.sum() < _FEWEST or np.median(np.abs(pitch[glide])) > FLAT:
        return []
    if np.median(np.abs(np.gradient(depth, period))[glide]) < FALLS:
        return []
    return [("measured_pitch", f"below {FLAT:g} degree at {FALLS:g} m/s of sinking; wrong unit?")]


ATTITUDE = ("measured_pitch", "measured_heading", "measured_roll")

DEEP = 10.0
"""[m], [dbar] Limit of depth: a vehicle that is deeper has no fix."""


def computer_of(log: DeploymentLog, segment: LogSegment) -> Channel:
    """Channel that shows when the vehicle's computer runs during a row: `awake`, or an attitude
    that is sampled regularly; empty without any."""
    for name in ("awake", *ATTITUDE):
        one = log.channel(name).within(segment.start, segment.end)
        if len(one) >= _FEWEST and not one.on_change:
            return one
    return EMPTY


def running(log: DeploymentLog, segment: LogSegment, times: Array) -> NDArray[np.bool_]:
    """True while the vehicle's computer runs; always true if nothing shows it."""
    shown = computer_of(log, segment)
    return shown.covers(times) | floating(shown, log, segment, times) | (not len(shown))


def floating(
    channel: Channel, log: DeploymentLog, segment: LogSegment, times: Array
) -> NDArray[np.bool_]:
    """True while a vehicle waits at the surface for the fix at a row's end: before a channel's
    first sample, or after its last."""
    floats = np.zeros(len(times), bool)
    depth = log.channel("measured_depth").within(segment.start, segment.end)
    inside = channel.within(segment.start, segment.end)
    if len(depth) and len(inside):
        first, last = inside.time[0], inside.time[-1]
        if segment.start_fix is not None and depth.at(first) < DEEP:
            floats |= times < first
        if segment.end_fix is not None and depth.at(last) < DEEP:
            floats |= times > last
    return floats
