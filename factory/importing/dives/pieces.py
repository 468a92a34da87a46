"""Pieces: rows of a log that is not cut into dives, such as the runs of a propelled vehicle."""

from __future__ import annotations

import numpy as np

from factory.importing.dives.segments import Segment
from factory.importing.reading.deployment_log import DeploymentLog, Fixes
from factory.importing.reading.tally import Tally
from factory.importing.repairs.dive_rules import DiveRules
from factory.importing.repairs.gps_fixes import good_fixes, tell_fixes
from twin.geodesy import offset

NEAR_END = 5.0
"""[s] A fix so near to a row's end stands for it."""


def pieces(log: DeploymentLog, rules: DiveRules, tally: Tally) -> list[Segment]:
    """The rows that the reader of a log has found, in time order, with their fixes.

    Rows shorter than `rules.min_duration` are left out, counted.
    """
    assert log.pieces is not None
    fixes = good_fixes(log.fixes, log.channel("measured_depth"), rules, tally)
    long = [span for span in log.pieces if span[1] - span[0] >= rules.min_duration]
    tally.add(
        "left out", "rows", len(log.pieces) - len(long), f"shorter than {rules.min_duration:g} s"
    )
    used = np.zeros(len(fixes), bool)
    for start, end in long:
        used |= (fixes.time >= start) & (fixes.time <= end)
    tell_fixes(fixes, used, tally, kept="within rows", left_out="outside rows")
    return [_segment(start, end, fixes.within(start, end)) for start, end in long]


def _segment(start: float, end: float, inside: Fixes) -> Segment:
    nothing = (float("nan"), float("nan"))
    first, last = _near(inside, start), _near(inside, end)
    moved = nothing
    if first is not None and last is not None:
        north, east = offset(np.float64(last[0]), np.float64(last[1]), *first)
        moved = (float(north), float(east))
    return Segment(
        start=start,
        end=end,
        start_fix=first,
        end_fix=last,
        displacement=moved,
        surface_duration=float("nan"),
        surface_drift=nothing,
        inside=inside,
    )


def _near(fixes: Fixes, time: float) -> tuple[float, float] | None:
    """Latitude and longitude of the fix nearest to a row's end, where one is near."""
    if not len(fixes):
        return None
    k = int(np.argmin(np.abs(fixes.time - time)))
    if abs(fixes.time[k] - time) > NEAR_END:
        return None
    return float(fixes.latitude[k]), float(fixes.longitude[k])
