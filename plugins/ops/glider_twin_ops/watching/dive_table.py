"""Dive table: the last dives of a log row by row, and the newest readings of battery and vacuum."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from glider_twin_ops.forecast import LoggedLeg
from glider_twin_ops.watching.sources import SurfaceDialogue
from twin.records import LogStore
from twin.records.attributes import DIVE_DURATION
from twin.records.coordinates import utc_minute

MOST_ROWS = 12
"""Maximum number of rows of the table: the last dives"""
DESCENT, CLIMB = 1, 2
"""Values of `measured_phase`"""
HOUR, KILO = 3600.0, 1e3
LOGGED = {"measured_voltage": ("battery", "V", 1.0), "measured_vacuum": ("vacuum", "hPa", 0.01)}
"""Name, unit and factor of each reading, by its signal"""
INCH_OF_MERCURY = 33.8639
"""[hPa] Unit in which a Slocum reports its vacuum"""
LATEST = 600.0
"""[s] Time before the last reading of a signal over which the median is taken"""
REPORTED = {
    "m_battery": "battery", "m_vacuum": "vacuum", "m_leakdetect_voltage": "leak detector",
    "battery_10V": "battery, 10 V", "battery_24V": "battery, 24 V",
    "internal_pressure": "internal pressure", "humidity": "humidity",
}  # fmt: skip
"""Readings of dialogues, by the vehicle's name for them"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveRow:
    """One dive; NaN for a value that the log does not have."""

    number: int
    begin: float
    """[s] unix"""
    hours: float
    depth: float
    """[m] Greatest depth"""
    yos: int
    """Number of descents that are followed by a climb"""
    km: float
    """[km] Distance over ground from fix to fix"""
    speed: float
    """[m/s] Distance over ground divided by the dive's duration"""
    course: float
    """[degree] Course over ground"""
    current: tuple[float, float]
    """[m/s] Mean current of the dive, north and east"""

    def row(self) -> dict[str, str]:
        """Cells of the page's table, by their headings."""
        speed, towards = polar(*self.current)
        return {
            "dive": f"{self.number}",
            "from, UTC": utc_minute(self.begin)[5:] if math.isfinite(self.begin) else "-",
            "hours": _cell(self.hours, ".1f"),
            "depth [m]": _cell(self.depth, ".0f"),
            "yos": f"{self.yos}",
            "km over ground": _cell(self.km, ".2f"),
            "towards": _cell(self.course, "03.0f"),
            "m/s over ground": _cell(self.speed, ".2f"),
            "current [m/s]": _cell(speed, ".2f"),
            "current towards": _cell(towards, "03.0f"),
        }

    def describe(self) -> dict[str, Any]:
        """Values for JSON, None where the log does not have them."""
        values = dataclasses.asdict(self) | {"current": list(self.current)}
        known = self.current if math.isfinite(self.current[0]) else None
        return {k: None if v != v else v for k, v in values.items()} | {"current": known}


def _cell(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "-"


def polar(north: float, east: float) -> tuple[float, float]:
    """Size and course [degree] of a vector; a course of 359.5 or more becomes 0."""
    course = math.degrees(math.atan2(east, north)) % 360.0
    return math.hypot(north, east), 0.0 if course >= 359.5 else course  # no chart writes 360


def dive_rows(
    logs: LogStore, rows: Sequence[int], numbers: Sequence[int], legs: Sequence[LoggedLeg]
) -> tuple[DiveRow, ...]:
    """Make the rows of the last dives, in order of time.

    Args:
      rows: rows of the dives in the store. numbers: the vehicle's numbers of these dives.
      legs: legs of the deployment; a dive without a leg has no path and no current.
    """
    by_row = {one.mission: one.leg for one in legs}
    durations, found = logs.number(DIVE_DURATION), []
    for row, number in list(zip(rows, numbers, strict=True))[-MOST_ROWS:]:
        depth, seconds = logs.signal("measured_depth", row), float(durations[row])
        leg, km, course = by_row.get(row), math.nan, math.nan
        current = math.nan, math.nan
        if leg is not None:
            metres, course = polar(*leg.over_ground)
            km, current = metres / KILO, (float(leg.current[0]), float(leg.current[1]))
        found.append(
            DiveRow(
                number=number,
                begin=float(logs.starts[row]),
                hours=seconds / HOUR,
                depth=float(np.nanmax(depth)) if np.isfinite(depth).any() else math.nan,
                yos=_yos(logs, row),
                km=km,
                speed=km * KILO / seconds if seconds > 0.0 else math.nan,
                course=course,
                current=current,
            )
        )
    return tuple(found)


def _yos(logs: LogStore, row: int) -> int:
    phase = logs.signal("measured_phase", row)
    moving = phase[(phase == DESCENT) | (phase == CLIMB)]
    return int(((moving[:-1] == DESCENT) & (moving[1:] == CLIMB)).sum())


class Reading(NamedTuple):
    """Newest value of one housekeeping sensor."""

    what: str
    value: float
    unit: str
    time: float
    """[s] unix"""

    def text(self) -> str:
        """Value with its unit and time, for a page."""
        shown = f"{self.value:.4g} {self.unit}"
        if self.unit == "hPa":
            shown = f"{self.value:.0f} hPa ({self.value / INCH_OF_MERCURY:.1f} inHg)"
        return f"{shown}, {utc_minute(self.time)[5:]}"


def newest_readings(
    logs: LogStore, rows: Sequence[int], dialogue: SurfaceDialogue | None
) -> tuple[Reading, ...]:
    """Newest voltage and vacuum of a log or of a newer dialogue."""
    found: dict[str, Reading] = {}
    for signal, (what, unit, factor) in LOGGED.items():
        for row in reversed(rows if signal in logs else ()):
            values = logs.signal(signal, row)
            known = np.flatnonzero(np.isfinite(values))
            if known.size:
                last = known[(known[-1] - known) * logs.period <= LATEST]
                time = float(logs.starts[row] + known[-1] * logs.period)
                found[what] = Reading(what, factor * float(np.median(values[last])), unit, time)
                break
    sensors: Mapping[str, tuple[float, str]] = {} if dialogue is None else dialogue.sensors
    for name, what in REPORTED.items():
        if dialogue is not None and name in sensors:
            value, unit = sensors[name]
            if what not in found or found[what].time < dialogue.time:
                unit = {"volts": "V", "inHg": "inHg"}.get(unit, unit)
                found[what] = Reading(what, value, unit, dialogue.time)
    return tuple(found.values())
