"""Angles of a log: their unit, and the magnetic declination if the log has none.

Units are used as declared, or inferred from a glider's possible angles. The declination is IGRF's.
"""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import EMPTY, Channel, LoggedFixes
from factory.importing.plausibility import sinks_in_radian
from factory.importing.tally import Tally
from factory.importing.units import declared, factor_of, is_declared, is_of

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
"""[rad] Full turn."""
MARGIN = 1.05
"""Factor by which rounding and calibration may take a heading beyond a full turn."""
_SHARE = 0.1
"""Fraction of values above the second limit of REACH that shows degrees; sentinels are fewer."""
REACH = {
    "pitch": (1.6, 1.6),
    "roll": (MARGIN * np.pi, 0.7),
    "heading": (MARGIN * TURN, MARGIN * TURN),
    "fin": (1.6, 0.7),
    "variation": (1.2, 1.2),
}
"""[rad] Two limits of each angle's size: the largest possible, and that which only an angle in
degrees exceeds in a tenth of its values. Pitch and rudder stay below 90 degree. No glider spends a
tenth of its time with a roll or rudder of 40 degree. Variation is below 70 degree on all routes."""
_SLIGHT = 0.15
"""[rad] A roll that stays below this (8.6 degree) is in radian: in degrees it would be no roll."""


def in_degrees(kind: str, values: Array) -> bool | None:
    """Tell by their values whether angles are in degrees: True, False (radian) or None (either).

    Args:
      kind: a key of `REACH`.
    """
    size = np.abs(values[np.isfinite(values)])
    size = size[size <= MARGIN * 360.0]  # beyond: no angle in any unit
    if not size.size:
        return None
    if np.mean(size > REACH[kind][1]) > _SHARE:
        return True
    if kind == "roll":
        return False if np.percentile(size, 90.0) < _SLIGHT else None
    return False


def to_degrees(
    values: Array, subject: str, tally: Tally, *, kind: str, likely: bool = False
) -> Array:
    """Convert native radian to degrees; a column that is in degrees already is kept, counted.

    Impossible values become NaN, are counted, and do not decide the unit.

    Args:
      kind: a key of `REACH`.
      likely: True when the log's other angles are in degrees; used if these values do not decide.
    """
    degrees = in_degrees(kind, values)
    if degrees is None:
        degrees = likely
    values = values * (1.0 if degrees else 180.0 / np.pi)
    largest = np.degrees(REACH[kind][0])
    bad = np.isfinite(values) & (np.abs(values) > largest)
    values = tally.removed(values, bad, subject, f"no {kind}: beyond {largest:.0f} degree")
    if degrees:
        there = np.isfinite(values)
        tally.add("repaired", subject, there, "was in degrees where radian is native")
    return values


def jointly_degrees(channels: Mapping[str, Channel], kinds: Mapping[str, str]) -> bool:
    """True when most of the log's angles that show their unit are in degrees.

    One vehicle's software writes all its angles in one unit, so that a roll that could be either
    follows the pitch and the heading.
    """
    said = [in_degrees(kinds[n], c.values) for n, c in channels.items() if n in kinds and len(c)]
    return said.count(True) > said.count(False)


_TURN = 378.0
"""[degree] Largest heading: a full turn and a twentieth."""
_NEARLY_ALL = 0.95
"""Fraction of the values that a unit must fit; the rest can be sentinels."""
_LEVEL, _FLAT = 0.01, 0.5 * np.pi
"""Range of a dive's largest pitch in radian; in degrees it would be too flat for a dive."""
FLYING = 20.0
"""[m] Depth beyond which a glider must have pitched."""


def _is_flat(values: Array) -> bool:
    """True if a pitch stays below pi/2, so that it may be in radian."""
    good = np.abs(values[np.isfinite(values)])
    good = good[good <= 90.0]  # sentinels do not count
    return bool(good.size > 20 and _LEVEL < np.percentile(good, 99.0) < _FLAT)


def from_degrees(values: Array, subject: str, tally: Tally, *, flying: bool) -> Array:
    """Angles in degrees; a pitch that stays below pi/2 in flight is converted from radian."""
    return _of_radian(values, subject, tally) if flying and _is_flat(values) else values


def _of_radian(values: Array, subject: str, tally: Tally, said: str = "native") -> Array:
    tally.add("repaired", subject, np.isfinite(values), f"was in radian where degrees are {said}")
    return np.degrees(values)


def within_a_turn(values: Array, subject: str, tally: Tally) -> Array:
    """Remove sentinels from headings [degree], which a modulo would turn into headings; counted."""
    impossible = np.isfinite(values) & (np.abs(values) > _TURN)
    return tally.removed(values, impossible, subject, f"no heading: beyond {_TURN:g} degree")


def heading_degrees(values: Array, subject: str, tally: Tally) -> Array:
    """Heading in degrees; values that turn within 0 to 2 pi are converted from radian, counted."""
    values = within_a_turn(values, subject, tally)
    good = values[np.isfinite(values)]
    inside = np.abs(values) < 1.01 * TURN
    turns = good.size > 20 and np.ptp(np.percentile(good, [5.0, 95.0])) > 1.0
    if turns and inside[np.isfinite(values)].mean() > _NEARLY_ALL:
        return np.where(inside, _of_radian(values, subject, tally), np.nan)
    return values


def turns_in_radian(heading: Array) -> bool:
    """True if headings fit a turn in radian and vary by more than half of it."""
    good = heading[np.isfinite(heading)]
    if good.size <= 20 or np.mean((good >= -np.pi) & (good < 1.01 * TURN)) <= _NEARLY_ALL:
        return False
    return bool(np.ptp(np.percentile(good, [5.0, 95.0])) > np.pi)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LoggedAngle:
    """Attitude angle, as a file has it."""

    values: Array
    unit: str
    """Unit that the file declares; empty if it declares none."""
    subject: str
    """Name of the variable, for the report."""
    native: str = "degree"
    """Unit of the format, degree or radian, where none is declared or shown by the values."""

    @property
    def said(self) -> str:
        """Unit of the values by the file, else by the format."""
        return self.unit if is_declared(self.unit) else self.native

    @property
    def in_radian(self) -> bool:
        """True if the unit of the values is radian."""
        return is_of(self.said, "degree") and factor_of(self.said, "degree") == np.degrees(1.0)


def attitude_degrees(
    angles: Mapping[str, LoggedAngle],
    time: Array,
    depth: Array | None,
    tally: Tally,
    *,
    deployment: str = "",
) -> dict[str, Array]:
    """Convert angles of one log to degrees as declared; leave out those of another quantity.

    Sink rate and pitch show radian labelled as degrees: a glider that sinks by 0.16 m/s at a pitch
    of 0.3 degree would fly at 27 m/s. A program writes all its angles in one unit, so that roll and
    heading have the unit that the pitch shows.

    Args:
      angles: by a key of `REACH`.
      time: [s] unix, (samples,).
      depth: [m] at the same times, or a pressure [dbar], or None.
    """
    found: dict[str, Array] = {}
    degrees = any(in_degrees(kind, one.values) for kind, one in angles.items() if one.in_radian)
    for kind, one in angles.items():
        if one.in_radian:
            found[kind] = to_degrees(one.values, one.subject, tally, kind=kind, likely=degrees)
            continue
        values = declared(
            one.values, one.unit, "degree", one.subject, tally, native=one.native,
            deployment=deployment,
        )  # fmt: skip
        if values is not None:
            found[kind] = values
    radian = "pitch" in found and _is_called_degrees(
        angles["pitch"], found["pitch"], time, depth, tally, deployment
    )
    for kind in found if radian else ():
        one, (largest, _) = angles[kind], REACH[kind]
        size = np.abs(found[kind])
        size = size[size <= _TURN]
        if not one.in_radian and size.size and np.mean(size <= largest) > _NEARLY_ALL:
            said = "declared: so it dives" if is_declared(one.unit) else "native"
            values = _of_radian(found[kind], one.subject, tally, said)
            found[kind] = np.where(np.abs(values) <= np.degrees(largest), values, np.nan)
    if "heading" in found and not radian:
        one = angles["heading"]
        turned = within_a_turn if is_declared(one.unit) or one.in_radian else heading_degrees
        found["heading"] = turned(found["heading"], one.subject, tally)
        if turned is within_a_turn and not one.in_radian and turns_in_radian(found["heading"]):
            why = "turns, and never leaves 6.3 degree: radian that are called degrees?"
            tally.doubt(one.subject, why, np.isfinite(found["heading"]), deployment=deployment)
    return found


def calls_itself_magnetic(attributes: Mapping[str, object]) -> bool:
    """True if a variable's description says that it is from magnetic north."""
    words = (str(attributes.get(key, "")) for key in ("long_name", "comment", "standard_name"))
    return "magnetic" in " ".join(words).lower()


def _is_called_degrees(
    one: LoggedAngle,
    pitch: Array,
    time: Array,
    depth: Array | None,
    tally: Tally,
    deployment: str,
) -> bool:
    """True if a pitch declared in degrees is in radian; a pitch that is neither becomes suspect."""
    if one.in_radian or depth is None or not _is_flat(pitch):
        return False
    depth = np.abs(depth)  # some files count depth upward
    flying = bool(np.nanmax(depth, initial=0.0) > FLYING)
    sinks = sinks_in_radian(time, depth, pitch)
    guessed = (one.native == "radian" and sinks is None) if is_declared(one.unit) else flying
    if sinks is False and flying and not guessed:
        why = "below 1.5 degree where the vehicle dives: radian, or of another quantity?"
        tally.doubt(one.subject, why, np.isfinite(pitch), deployment=deployment)
    return bool(sinks) or guessed


_DAY = 86400.0
"""[s] Interval of the declination: a glider moves some tens of kilometres in a day."""
FIRST, LAST = datetime.datetime(1900, 1, 1), datetime.datetime(2030, 1, 1)
"""Dates that IGRF-14 covers."""


def reference_declination(places: LoggedFixes, subject: str, tally: Tally) -> Channel:
    """Declination [degree], east positive, by IGRF-14 at sea level; empty without a position.

    Each day with positions gets one value, at their median.

    Args:
      places: positions of the vehicle: its fixes, or its own track.
      subject: the deployment, for the report.
    """
    if not len(places):
        return EMPTY
    import ppigrf

    days = np.floor(places.time / _DAY)
    times, values = [], []
    for day in np.unique(days):
        here = places.keep(days == day)
        latitude, longitude = here.middle
        date = datetime.datetime.fromtimestamp((day + 0.5) * _DAY, datetime.UTC)
        moment = min(max(date.replace(tzinfo=None), FIRST), LAST)
        east, north, _ = ppigrf.igrf(longitude, latitude, 0.0, moment)
        times.append(float(np.median(here.time)))
        values.append(float(np.degrees(np.arctan2(np.ravel(east)[0], np.ravel(north)[0]))))
    low, high = min(values), max(values)
    size = f"{low:.2f}" if high - low < 0.01 else f"{low:.2f} to {high:.2f}"
    tally.add(
        "note", "magnetic variation", 1,
        f"{subject}: the log has none; {size} degree by IGRF-14 at its place and date",
    )  # fmt: skip
    return Channel(np.array(times), np.array(values))
