"""Dates: the time axis of a log, whose ticks are moments in UTC."""

from __future__ import annotations

import datetime
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator
from matplotlib.ticker import Formatter, Locator

from twin.records.attributes import is_logged
from twin.records.coordinates import START_TIME, unix_seconds
from twin.records.trajectory import Trajectory
from twin.show import style

MINUTE, DAY = 60.0, 86400.0
"""[s]"""
LABEL = "time, UTC"


class DateLocator(Locator):
    """Ticks at round moments on an axis that counts `seconds` each from the unix time `start`."""

    def __init__(self, start: float, seconds: float, most: int = 7):
        self._start, self._seconds = start, seconds
        self._dates = AutoDateLocator(minticks=3, maxticks=most)

    def __call__(self) -> Sequence[float]:
        """Ticks of what the axis shows."""
        assert self.axis is not None
        low, high = self.axis.get_view_interval()
        return self.tick_values(low, high)

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """Ticks between two values of the axis, with the ends where dates are rounder."""
        ends = (moment_of(self._start + self._seconds * x) for x in sorted((vmin, vmax)))
        days = np.asarray(self._dates.tick_values(*ends), float)
        found: list[float] = ((days * DAY - self._start) / self._seconds).tolist()
        return found


class DateFormatter(Formatter):
    """Writes such ticks: the time of day, below it the date where a day begins; or the date."""

    def __init__(self, start: float, seconds: float):
        self._start, self._seconds = start, seconds

    def __call__(self, x: float, pos: int | None = None) -> str:
        """One moment, as where the pointer is."""
        return f"{moment_of(self._start + self._seconds * x):%Y-%m-%d %H:%M:%S}"

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """The texts of all ticks of the axis."""
        moments = [moment_of(self._start + self._seconds * x) for x in values]
        steps = np.diff([one.timestamp() for one in moments])
        step = float(steps.min()) if len(steps) else 0.0
        if step >= DAY - 1.0:
            upper, lower = "%m-%d", "%Y"
        else:
            upper, lower = "%H:%M" if step >= MINUTE else "%H:%M:%S", "%Y-%m-%d"
        texts, said = [], ""
        for one in moments:
            below = f"{one:{lower}}"
            texts.append(f"{one:{upper}}" + (f"\n{below}" if below != said else ""))
            said = below
        return texts


def moment_of(unix: float) -> datetime.datetime:
    """The moment of a unix time [s], to the second."""
    return datetime.datetime.fromtimestamp(round(unix), datetime.UTC)


def draw_dates(axes: Axes, start: float, seconds: float) -> None:
    """Make dates the ticks of a time axis.

    Args:
      start: unix time [s] at 0 of the axis.
      seconds: of one on the axis.
    """
    axes.xaxis.set_major_locator(DateLocator(start, seconds))
    axes.xaxis.set_major_formatter(DateFormatter(start, seconds))


def label_time(axes: Axes, trajectory: Trajectory, seconds: float, unit: str) -> None:
    """Label a time axis of a mission, of a log with dates.

    Args:
      seconds: of one on the axis, whose name is `unit`.
    """
    start = trajectory.provenance.get(START_TIME) if is_logged(trajectory.provenance) else None
    if start is None:
        style.label_time(axes, unit)
        return
    draw_dates(axes, unix_seconds(str(start)), seconds)
    axes.set_xlabel(LABEL)
