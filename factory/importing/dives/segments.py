"""Segments: logs cut into dives from GPS fix to GPS fix, with surface drift and phases."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import NO_FIXES, Channel, DeploymentLog, LoggedFixes
from factory.importing.gps_fixes import good_fixes, tell_fixes
from factory.importing.plausibility import DiveRules, runs
from factory.importing.tally import Tally
from twin.geodesy import offset

Array = NDArray[np.float64]
DESCENT, CLIMB, LEVEL, SURFACE = 1, 2, 3, 0
PHASES = {SURFACE: "surface", DESCENT: "descent", CLIMB: "climb", LEVEL: "inflection_or_level"}
"""Flags of `measured_phase`, and their meanings."""
NOWHERE = (float("nan"), float("nan"))
"""Unknown position, displacement or drift."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogSegment:
    """Segment of a log, one row: a dive from fix to fix, or as much of it as the log contains."""

    start: float
    """[s] Unix time of the last fix before the dive, else of the first sample."""
    end: float
    """[s] Unix time of the first fix after the dive, else of the last sample."""
    start_fix: tuple[float, float] | None
    """Latitude, longitude [degree]."""
    end_fix: tuple[float, float] | None
    displacement: tuple[float, float]
    """[m] Displacement north and east over ground between the fixes; NaN without both."""
    surface_duration: float
    """[s] Time between the fixes at the surface before the row; NaN if unknown."""
    surface_drift: tuple[float, float]
    """[m/s] Drift north and east in that time."""
    inside: LoggedFixes = NO_FIXES
    """Fixes within a row that is no dive: a vehicle at the surface has fixes all the time."""

    @property
    def duration(self) -> float:
        """[s] Time from start to end."""
        return self.end - self.start


def cut(log: DeploymentLog, depth: Channel, rules: DiveRules, tally: Tally) -> list[LogSegment]:
    """Cut a log into dives, in time order.

    Consecutive fixes with a dive between them make a row. A long silence splits it, as the vehicle
    may have surfaced. Before the first and after the last fix, and in logs without fixes, rows are
    split at surfacings and at gaps.
    """

    def is_dive(inside: Channel) -> bool:
        return longest_stretch(inside, rules.min_depth) >= rules.min_stretch

    fixes = good_fixes(log.fixes, depth, rules, tally, station=log.station)
    first, last = log.span
    edges = [first - 1.0, *fixes.time.tolist(), last + 1.0]
    segments: list[LogSegment] = []
    short = holes = noise = 0
    for k in range(len(edges) - 1):
        start, end = edges[k], edges[k + 1]
        inside = depth.within(start, end)
        if not is_dive(inside):
            noise += int((inside.values > rules.min_depth).sum())
            continue
        has_start, has_end = k > 0, k < len(edges) - 2
        if has_start and has_end:
            parts = [(start, end)] if log.station else _between_holes(log, start, end, rules)
            holes += len(parts) - 1
            parts = [part for part in parts if is_dive(depth.within(*part))]
        else:
            parts = split_without_fixes(inside, rules)
            if has_start and parts and parts[0][0] - start < rules.longest_gap:
                parts[0] = (start, parts[0][1])
            if has_end and parts and end - parts[-1][1] < rules.longest_gap:
                parts[-1] = (parts[-1][0], end)
        for part in parts:
            if part[1] - part[0] < rules.min_duration:
                short += 1
                continue
            before = k - 1 if has_start and part[0] == start else None
            after = k if has_end and part[1] == end else None
            previous_end = segments[-1].end if segments else None
            segments.append(_segment(fixes, part, before, after, previous_end, rules))
    why = f"split where neither depth nor attitude is known for {rules.longest_gap:g} s"
    tally.add("note", "rows", holes, why)
    why = f"deeper than {rules.min_depth:g} m for less than {rules.min_stretch:g} s: no dive"
    tally.add("left out", "depth samples", noise, why)
    tally.add("left out", "dives", short, f"shorter than {rules.min_duration:g} s")
    carried = [s for s in segments if np.hypot(*s.surface_drift) > rules.drift_speed]
    why = f"faster than {rules.drift_speed:g} m/s: carried, or a wrong fix"
    tally.add("left out", "surface drift", len(carried), why)
    segments = [
        dataclasses.replace(s, surface_drift=NOWHERE) if s in carried else s for s in segments
    ]
    _tell_holes(log, depth, tally)
    ends = [s.start for s in segments if s.start_fix is not None]
    ends += [s.end for s in segments if s.end_fix is not None]
    tell_fixes(
        fixes, np.isin(fixes.time, ends), tally, kept="that dives begin and end with",
        left_out="at the surface beside those that dives begin and end with; the drift of the stay "
        "before each dive is kept",
    )  # fmt: skip
    open_ended = sum(1 for s in segments if s.start_fix is None or s.end_fix is None)
    tally.add("note", "rows", open_ended, "without a fix at one or both ends")
    return segments


def _between_holes(
    log: DeploymentLog, start: float, end: float, rules: DiveRules
) -> list[tuple[float, float]]:
    """Start and end of each part of a log between two fixes, split at its long silences."""
    names = ("measured_depth", "measured_pitch")
    known = [log.channel(name).within(start, end).time for name in names]
    times = np.unique(np.concatenate([[start, end], *known]))
    silent = np.flatnonzero(np.diff(times) > rules.longest_gap)
    begins = np.concatenate([[start], times[silent + 1]])
    ends = np.concatenate([times[silent], [end]])
    return [(float(a), float(b)) for a, b in zip(begins, ends, strict=True) if b > a]


def longest_stretch(depth: Channel, deeper: float) -> float:
    """[s] Longest time at a stretch during which the samples are below `deeper`.

    Each sample stands for the time around it, at most `_STANDS_FOR` usual spacings. In a log with
    samples more often than every `_OFTEN` s, stretches of fewer than `_SEVERAL` samples are noise.
    """
    if not len(depth) or not (depth.values > deeper).any():
        return 0.0
    if len(depth) < 3:
        return float("inf")  # too few to tell a dive from noise
    gap = np.minimum(np.diff(depth.time), _STANDS_FOR * depth.spacing)
    stands = 0.5 * (np.append(gap, gap[-1]) + np.append(gap[:1], gap))
    under = runs(depth.values > deeper)
    fewest = _SEVERAL if depth.spacing < _OFTEN else 1
    long = [float(stands[start:end].sum()) for start, end in under if end - start >= fewest]
    return max(long, default=0.0)


_STANDS_FOR = 3.0
"""Largest number of usual sample spacings for which one sample stands."""
_SEVERAL, _OFTEN = 3, 20.0
"""A dive needs _SEVERAL samples if spaced by less than _OFTEN [s]; a restarted sensor gives 2."""
_DAY = 86400.0
"""[s] One day."""


def _tell_holes(log: DeploymentLog, depth: Channel, tally: Tally) -> None:
    """Report where a log pauses for more than a day: it may be two deployments."""
    for k in np.flatnonzero(np.diff(depth.time) > _DAY):
        days = (depth.time[k + 1] - depth.time[k]) / _DAY
        day = np.datetime64(int(depth.time[k]), "s").astype("datetime64[D]")
        tally.add("note", log.deployment, 1, f"silent for {days:.1f} days from {day}")


def _segment(
    fixes: LoggedFixes,
    span: tuple[float, float],
    first: int | None,
    last: int | None,
    previous_end: float | None,
    rules: DiveRules,
) -> LogSegment:
    """Make one row; `first` and `last` index the fixes at its ends."""
    drift, waited = NOWHERE, float("nan")
    if first is not None:
        around = fixes.within(fixes.time[0] if previous_end is None else previous_end, span[0])
        holes = np.flatnonzero(np.diff(around.time) > rules.longest_gap)
        if holes.size:  # the vehicle may have dived in a gap: begin after the last one
            around = around.keep(np.arange(len(around)) > holes[-1])
        if len(around) > 1:
            waited = float(around.time[-1] - around.time[0])
            drift = surface_drift(around)
    return _make_segment(
        span, *(None if i is None else _place(fixes, i) for i in (first, last)),
        surface_duration=waited, surface_drift=drift,
    )  # fmt: skip


Place = tuple[float, float]
"""Latitude and longitude [degree]."""


def _place(fixes: LoggedFixes, k: int) -> Place:
    return float(fixes.latitude[k]), float(fixes.longitude[k])


def _make_segment(span: Place, first: Place | None, last: Place | None, **stay: Any) -> LogSegment:
    """Make a row of times `span` [s] between two positions; `stay`: surface interval before it."""
    moved = NOWHERE
    if first is not None and last is not None:
        north, east = offset(np.float64(last[0]), np.float64(last[1]), *first)
        moved = (float(north), float(east))
    return LogSegment(
        start=span[0], end=span[1], start_fix=first, end_fix=last, displacement=moved, **stay
    )


_DRIFT_TIME = 60.0
"""[s] Shortest time that gives a drift; over less, the noise of two fixes exceeds the drift."""


def surface_drift(fixes: LoggedFixes) -> tuple[float, float]:
    """Drift north and east [m/s] by a line through the fixes; NaN for less than a minute."""
    time = fixes.time - fixes.time[0]
    if time[-1] < _DRIFT_TIME:
        return NOWHERE
    north, east = offset(fixes.latitude, fixes.longitude, *_place(fixes, 0))
    spread = time - time.mean()
    weight = spread / (spread @ spread)
    return float(weight @ north), float(weight @ east)


def split_without_fixes(depth: Channel, rules: DiveRules) -> list[tuple[float, float]]:
    """Start and end of each dive by depth alone: from surfacing to surfacing or gap."""
    wet = depth.values > rules.surface_depth
    breaks = np.flatnonzero(np.diff(depth.time) > rules.longest_gap) + 1
    found: list[tuple[float, float]] = []
    for part in np.split(np.arange(len(depth)), breaks):
        for down, up in runs(wet[part]):
            rows = part[down:up]
            under = Channel(depth.time[rows], depth.values[rows])
            if longest_stretch(under, rules.min_depth) >= rules.min_stretch:
                # the surface sample on either side belongs to the dive
                low, high = max(part[0], rows[0] - 1), min(part[-1], rows[-1] + 1)
                found.append((float(depth.time[low]), float(depth.time[high])))
    return found


_RATE_WINDOW = 20.0
"""[s] Averaging time of the vertical speed, far shorter than a dive's turns."""
_STILL = 0.03
"""[m/s] Vertical speed below which a glider is turning, level or hanging."""


def phases(time: Array, depth: Array, surface_depth: float) -> Array:
    """Phase of each sample from depth [m]: 0 surface, 1 descent, 2 climb, 3 inflection or level."""
    half = max(1, round(0.5 * _RATE_WINDOW / max(time[1] - time[0], 1e-9))) if len(time) > 1 else 1
    index = np.arange(len(time))
    low, high = np.maximum(index - half, 0), np.minimum(index + half, len(time) - 1)
    span = np.maximum(time[high] - time[low], 1e-9)
    rate = (depth[high] - depth[low]) / span
    phase = np.where(rate > 0.0, DESCENT, CLIMB)
    phase = np.where(np.abs(rate) < _STILL, LEVEL, phase)
    return np.where(depth < surface_depth, SURFACE, phase).astype(np.float64)


_AFLOAT = 3.0
"""[m] Greatest depth of the pressure sensor of a glider that is upright at the surface."""
_DIVING = 0.5
"""[m] Change of depth since the fix beyond which a vehicle dives: waves change depth by less."""
_AT_REST = 10.0
"""[s] Time over which the change of depth distinguishes floating from diving."""


def float_at_fixes(phase: Array, depth: Array, segment: LogSegment, period: float) -> Array:
    """Set the phase to 0 (surface) next to the fixes, while the depth stays as at the fix.

    A Seaglider hangs nose down during its fixes, with its pressure sensor 1 to 3 m under water.
    """
    phase = phase.copy()
    for fix, order in ((segment.start_fix, slice(None)), (segment.end_fix, slice(None, None, -1))):
        seen = depth[order]
        if fix is None or not seen[0] <= _AFLOAT:
            continue
        if np.ptp(seen[: max(2, round(_AT_REST / period) + 1)]) > _STILL * _AT_REST:
            continue  # the vehicle was diving when it logged the fix
        left = np.abs(seen - seen[0]) > _DIVING
        count = int(np.argmax(left)) if left.any() else len(left)
        phase[order][:count] = SURFACE
    return phase


NEAR_END = 5.0
"""[s] Longest time between an end of a row and the fix that gives its position."""


def pieces(log: DeploymentLog, rules: DiveRules, tally: Tally) -> list[LogSegment]:
    """Rows from the times `log.pieces` that a reader gave, in time order, with their fixes.

    Rows shorter than `rules.min_duration` are left out and counted in `tally`.
    """
    assert log.pieces is not None
    fixes = good_fixes(log.fixes, log.channel("measured_depth"), rules, tally)
    long = [span for span in log.pieces if span[1] - span[0] >= rules.min_duration]
    why = f"shorter than {rules.min_duration:g} s"
    tally.add("left out", "rows", len(log.pieces) - len(long), why)
    used = np.zeros(len(fixes), bool)
    rows = []
    for span in long:
        used |= (fixes.time >= span[0]) & (fixes.time <= span[1])
        inside = fixes.within(*span)
        ends = [_place_near(inside, edge) for edge in span]
        rows.append(
            _make_segment(
                span, *ends, surface_duration=float("nan"), surface_drift=NOWHERE, inside=inside
            )
        )
    tell_fixes(fixes, used, tally, kept="within rows", left_out="outside rows")
    return rows


def _place_near(fixes: LoggedFixes, time: float) -> Place | None:
    """Position of the fix nearest to a row's end; None if none is near."""
    if not len(fixes):
        return None
    k = int(np.argmin(np.abs(fixes.time - time)))
    return None if abs(fixes.time[k] - time) > NEAR_END else _place(fixes, k)
