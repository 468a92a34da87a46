"""Unit of each angle of a log, radian or degree, found from what a glider's angles can be.

Magnetic declination where a log has none: the reference field of the Earth at place and date.
"""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import EMPTY, Channel, LoggedFixes
from factory.importing.tally import Tally

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
"""[rad] A full turn."""
MARGIN = 1.05
"""Rounding and calibration take a heading a little beyond a full turn."""
_SHARE = 0.1
"""A unit is decided by more than this part of the possible values: sentinels are fewer."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reach:
    """What an angle of a glider can be, and what it usually is. All in radian."""

    largest: float
    """Values beyond it cannot be this angle."""
    usual: float
    """More than a tenth of the values beyond it: they are degrees."""


REACH = {
    "pitch": Reach(largest=1.6, usual=1.6),
    "roll": Reach(largest=MARGIN * np.pi, usual=0.7),
    "heading": Reach(largest=MARGIN * TURN, usual=MARGIN * TURN),
    "fin": Reach(largest=1.6, usual=0.7),
    "variation": Reach(largest=1.2, usual=1.2),
}
"""Pitch and rudder stay below 90 degree. No glider rolls by 40 degree for a tenth of its time, nor
is a rudder so far over; the variation is below 70 degree wherever gliders go."""
_SLIGHT = 0.15
"""A roll that never leaves so little is in radian (8.6 degree): as degrees it would be none."""


def in_degrees(kind: str, values: Array) -> bool | None:
    """Whether angles are in degrees by themselves; None when they can be either.

    Args:
      kind: a key of `REACH`.
    """
    size = np.abs(values[np.isfinite(values)])
    size = size[size <= MARGIN * 360.0]  # no angle in any unit
    if not size.size:
        return None
    if np.mean(size > REACH[kind].usual) > _SHARE:
        return True
    if kind == "roll":
        return False if np.percentile(size, 90.0) < _SLIGHT else None
    return False


def to_degrees(
    values: Array, subject: str, tally: Tally, *, kind: str, likely: bool = False
) -> Array:
    """Native radian in degrees. A column that is in degrees already is taken as it is, counted.

    Values that cannot be such an angle become NaN, are counted, and do not decide the unit.

    Args:
      kind: a key of `REACH`.
      likely: True when the log's other angles are in degrees; it decides where these do not.
    """
    degrees = in_degrees(kind, values)
    if degrees is None:
        degrees = likely
    factor = 1.0 if degrees else 180.0 / np.pi
    there = np.isfinite(values)
    largest = np.degrees(REACH[kind].largest)
    with np.errstate(invalid="ignore"):
        bad = there & (np.abs(values) * factor > largest)
    tally.add("removed", subject, int(bad.sum()), f"no {kind}: beyond {largest:.0f} degree")
    if degrees:
        tally.add(
            "repaired", subject, int((there & ~bad).sum()), "was in degrees where radian is native"
        )
    return np.where(bad, np.nan, values * factor)


def jointly_degrees(channels: Mapping[str, Channel], kinds: Mapping[str, str]) -> bool:
    """True when the angles of one log that can tell their unit are in degrees, by majority.

    One vehicle's software writes all its angles in one unit, so that a roll that could be either
    follows the pitch and the heading.
    """
    said = [
        in_degrees(kinds[name], channels[name].values)
        for name in channels
        if name in kinds and len(channels[name])
    ]
    yes, no = said.count(True), said.count(False)
    return yes > no


_DAY = 86400.0
"""[s] The field is evaluated once a day: a glider moves some tens of kilometres in it."""
FIRST, LAST = datetime.datetime(1900, 1, 1), datetime.datetime(2030, 1, 1)
"""What IGRF-14 covers."""


def reference_declination(places: LoggedFixes, subject: str, tally: Tally) -> Channel:
    """Declination [degree], east positive, by IGRF-14 at sea level; empty without a position.

    One value for each day with positions, at their median.

    Args:
      places: where the vehicle was: its fixes, or its own track.
      subject: the deployment, for the report.
    """
    if not len(places):
        return EMPTY
    import ppigrf

    days = np.floor(places.time / _DAY)
    times, values = [], []
    for day in np.unique(days):
        here = days == day
        date = datetime.datetime.fromtimestamp((day + 0.5) * _DAY, datetime.UTC)
        east, north, _ = ppigrf.igrf(
            float(np.median(places.longitude[here])), float(np.median(places.latitude[here])), 0.0,
            min(max(date.replace(tzinfo=None), FIRST), LAST),
        )  # fmt: skip
        times.append(float(np.median(places.time[here])))
        values.append(float(np.degrees(np.arctan2(np.ravel(east)[0], np.ravel(north)[0]))))
    low, high = min(values), max(values)
    size = f"{low:.2f}" if high - low < 0.01 else f"{low:.2f} to {high:.2f}"
    tally.add(
        "note", "magnetic variation", 1,
        f"{subject}: the log has none; {size} degree by IGRF-14 at its place and date",
    )  # fmt: skip
    return Channel(np.array(times), np.array(values))
