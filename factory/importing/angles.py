"""Unit of each angle of a log: as declared, else radian or degree by what a glider's can be.

Magnetic declination where a log has none: the reference field of the Earth at place and date.
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
"""[rad] A full turn."""
MARGIN = 1.05
"""Rounding and calibration take a heading a little beyond a full turn."""
_SHARE = 0.1
"""A unit is decided by more than this part of the possible values: sentinels are fewer."""
REACH = {
    "pitch": (1.6, 1.6),
    "roll": (MARGIN * np.pi, 0.7),
    "heading": (MARGIN * TURN, MARGIN * TURN),
    "fin": (1.6, 0.7),
    "variation": (1.2, 1.2),
}
"""[rad] Largest possible size of an angle, and the size that more than a tenth of its values exceed
only where they are degrees. Pitch and rudder stay below 90 degree. No glider rolls by 40 degree for
a tenth of its time, nor is a rudder so far over; the variation is below 70 degree wherever gliders
go."""
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
    if np.mean(size > REACH[kind][1]) > _SHARE:
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
    values = values * (1.0 if degrees else 180.0 / np.pi)
    largest = np.degrees(REACH[kind][0])
    bad = np.isfinite(values) & (np.abs(values) > largest)
    values = tally.removed(values, bad, subject, f"no {kind}: beyond {largest:.0f} degree")
    if degrees:
        there = np.isfinite(values)
        tally.add("repaired", subject, there, "was in degrees where radian is native")
    return values


def jointly_degrees(channels: Mapping[str, Channel], kinds: Mapping[str, str]) -> bool:
    """True when the angles of one log that can tell their unit are in degrees, by majority.

    One vehicle's software writes all its angles in one unit, so that a roll that could be either
    follows the pitch and the heading.
    """
    said = [in_degrees(kinds[n], c.values) for n, c in channels.items() if n in kinds and len(c)]
    return said.count(True) > said.count(False)


_TURN = 378.0
"""[degree] Nothing beyond a full turn and a twentieth is a heading."""
_NEARLY_ALL = 0.95
"""Part of the values that a unit must fit; the rest can be sentinels."""
_LEVEL, _FLAT = 0.01, 0.5 * np.pi
"""Range of a pitch in radian: as degrees no glider dives with it."""
FLYING = 20.0
"""[m] A glider that was deeper has pitched."""


def _is_flat(values: Array) -> bool:
    """Whether a pitch never leaves what would be 90 degree in radian."""
    good = np.abs(values[np.isfinite(values)])
    good = good[good <= 90.0]  # sentinels have no say
    return bool(good.size > 20 and _LEVEL < np.percentile(good, 99.0) < _FLAT)


def from_degrees(values: Array, subject: str, tally: Tally, *, flying: bool) -> Array:
    """Native degrees. A pitch that never leaves 1.5 in flight was in radian: converted, counted."""
    return _of_radian(values, subject, tally) if flying and _is_flat(values) else values


def _of_radian(values: Array, subject: str, tally: Tally, said: str = "native") -> Array:
    tally.add("repaired", subject, np.isfinite(values), f"was in radian where degrees are {said}")
    return np.degrees(values)


def within_a_turn(values: Array, subject: str, tally: Tally) -> Array:
    """Headings [degree] without sentinels, which a modulo would make headings; counted."""
    impossible = np.isfinite(values) & (np.abs(values) > _TURN)
    return tally.removed(values, impossible, subject, f"no heading: beyond {_TURN:g} degree")


def heading_degrees(values: Array, subject: str, tally: Tally) -> Array:
    """Heading in degrees; one that turns and never leaves 0 to 2 pi was in radian, counted."""
    values = within_a_turn(values, subject, tally)
    good = values[np.isfinite(values)]
    inside = np.abs(values) < 1.01 * TURN
    turns = good.size > 20 and np.ptp(np.percentile(good, [5.0, 95.0])) > 1.0
    if turns and inside[np.isfinite(values)].mean() > _NEARLY_ALL:
        return np.where(inside, _of_radian(values, subject, tally), np.nan)
    return values


def turns_in_radian(heading: Array) -> bool:
    """Whether headings turn by half a turn and more, if they are radian, and by nothing else."""
    good = heading[np.isfinite(heading)]
    if good.size <= 20 or np.mean((good >= -np.pi) & (good < 1.01 * TURN)) <= _NEARLY_ALL:
        return False
    return bool(np.ptp(np.percentile(good, [5.0, 95.0])) > np.pi)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LoggedAngle:
    """One angle of the attitude, as a file has it."""

    values: Array
    unit: str
    """As the file declares it; empty where it declares none."""
    subject: str
    """The variable, for the report."""
    native: str = "degree"
    """Unit of the format, where nothing is declared or tells: degree or radian."""

    @property
    def said(self) -> str:
        """Unit of the values by the file, else by the format."""
        return self.unit if is_declared(self.unit) else self.native

    @property
    def in_radian(self) -> bool:
        """Whether that is radian."""
        return is_of(self.said, "degree") and factor_of(self.said, "degree") == np.degrees(1.0)


def attitude_degrees(
    angles: Mapping[str, LoggedAngle],
    time: Array,
    depth: Array | None,
    tally: Tally,
    *,
    deployment: str = "",
) -> dict[str, Array]:
    """Angles of one log in degrees, by what each declares; those of another quantity are left out.

    Radian that are called degrees are told by the sinking: a glider of 0.16 m/s at a third of a
    degree would fly at 27 m/s. One software writes all its angles in one unit, so that roll and
    heading follow the pitch.

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
    """Whether a variable says in its description that it is from magnetic north."""
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
    """Whether a pitch that is in degrees by its file is in radian; suspect if it is neither."""
    if one.in_radian or depth is None or not _is_flat(pitch):
        return False
    depth = np.abs(depth)  # some files count it upward
    flying = bool(np.nanmax(depth, initial=0.0) > FLYING)
    sinks = sinks_in_radian(time, depth, pitch)
    guessed = (one.native == "radian" and sinks is None) if is_declared(one.unit) else flying
    if sinks is False and flying and not guessed:
        why = "below 1.5 degree where the vehicle dives: radian, or of another quantity?"
        tally.doubt(one.subject, why, np.isfinite(pitch), deployment=deployment)
    return bool(sinks) or guessed


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
