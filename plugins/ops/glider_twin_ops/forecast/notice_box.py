"""Notice box: between which parallels and meridians a glider stays for twelve hours.

Authorities ask for such boxes. Their edges are the outermost of all members, rounded outward: one
more member would leave one of the four sides with a probability of 4 / (members + 1) at most.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from glider_twin_ops.forecast.surfacing import degrees
from glider_twin_ops.forecast.surfacing_forecast import Forecast, feature
from twin.geodesy import wrap_longitude

HOURS = 12.0
MINUTES = 60.0
"""In a degree"""
TENTH = 10.0
"""Parts of a minute that edges are rounded to: 185 m along a meridian"""
MOMENT = "%Y-%m-%d %H:%M"


@dataclasses.dataclass(frozen=True, kw_only=True)
class NoticeBox:
    """One box, in degrees; `west` is above `east` where it lies across the date line."""

    begin: datetime.datetime
    """UTC"""
    end: datetime.datetime
    south: float
    north: float
    west: float
    east: float
    holds: float
    """Least probability that the whole way lies inside"""

    def text(self) -> str:
        """One line, in degrees and minutes."""
        south, north = (_angle(value, "NS", 2) for value in (self.south, self.north))
        west, east = (_angle(value, "EW", 3) for value in (self.west, self.east))
        return (
            f"{self.begin:{MOMENT}} to {self.end:{MOMENT}} UTC: {south} to {north}, {west} to "
            f"{east}"
        )

    def feature(self) -> dict[str, Any]:
        """A GeoJSON feature; its longitudes go on across the date line."""
        east = self.east + (360.0 if self.east < self.west else 0.0)
        ring = [
            [self.west, self.south], [east, self.south], [east, self.north],
            [self.west, self.north], [self.west, self.south],
        ]  # fmt: skip
        begin, end = self.begin.isoformat(), self.end.isoformat()
        said = {"what": "box of a notice", "begin": begin, "end": end, "holds": self.holds}
        return feature("Polygon", [ring], said)


def notice_boxes(found: Forecast, hours: float = HOURS) -> list[NoticeBox]:
    """Boxes one after the other, to the end of a forecast's hours or of its members' plan.

    Args:
      found: of all members. hours: [h] of each box.
    """
    ways = [(time, degrees(way, found.request.place)) for time, way in found.ways]
    last = min(found.request.horizon, float(np.median([time[-1] for time, _ in ways])))
    boxes = []
    for begin in np.arange(0.0, last, hours * 3600.0):
        end = min(begin + hours * 3600.0, last)
        inside = np.concatenate([_between(time, way, begin, end) for time, way in ways])
        west, south = (math.floor(v * MINUTES * TENTH) / MINUTES / TENTH for v in inside.min(0))
        east, north = (math.ceil(v * MINUTES * TENTH) / MINUTES / TENTH for v in inside.max(0))
        west, east = wrap_longitude(np.array([west, east])).tolist()
        boxes.append(
            NoticeBox(
                begin=found.begins + datetime.timedelta(seconds=begin),
                end=found.begins + datetime.timedelta(seconds=end),
                south=south, north=north, west=west, east=east,
                holds=max(0.0, 1.0 - 4.0 / (len(ways) + 1)),
            )
        )  # fmt: skip
    return boxes


def boxes_text(boxes: Sequence[NoticeBox], title: str) -> str:
    """Lines for a message."""
    if not boxes:
        return f"{title}: no forecast, so no boxes\n"
    which = "these boxes" if len(boxes) > 1 else "this box"
    lines = [
        f"{title}: an underwater glider stays within {which} with a probability of "
        f"{100.0 * boxes[0].holds:.0f} %"
    ]
    return "\n".join([*lines, *(one.text() for one in boxes)]) + "\n"


def _between(time: np.ndarray, way: np.ndarray, begin: float, end: float) -> np.ndarray:
    """The points of a way within two times, those at the times themselves included."""
    at = np.concatenate([[begin], time[(time > begin) & (time < end)], [end]])
    return np.stack([np.interp(at, time, way[:, k]) for k in range(2)], axis=1)


def _angle(value: float, signs: str, digits: int) -> str:
    tenths = round(abs(value) * MINUTES * TENTH)
    whole, minutes = divmod(tenths, round(MINUTES * TENTH))
    return f"{whole:0{digits}d}-{minutes / TENTH:04.1f}{signs[value < 0.0]}"
