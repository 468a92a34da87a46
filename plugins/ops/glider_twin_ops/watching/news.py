"""News: what the dives since the last page changed, and how its forecast did."""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from glider_twin_ops.forecast import LoggedLeg
from glider_twin_ops.health import CHANNELS
from glider_twin_ops.watching.morning import Morning
from twin.cli import counted
from twin.geodesy import great_circle, offset
from twin.records.coordinates import utc_minute

MOVED = 2.0
"""Deviations by which a level must move to be told"""
MINUTE = 60.0


def news(before: Mapping[str, Any] | None, now: Morning) -> list[str]:
    """Sentences on what is new.

    Args:
      before: what `latest.json` of the page before said; None: there was none.
    """
    if before is None or before.get("deployment") != now.deployment:
        return []
    known = set(before.get("dives", ()))
    new = [number for number in now.dives if number not in known]
    said = [_dives(new)]
    gone = len(known - set(now.dives))
    if gone:
        said.append(f"{counted(gone, 'dive')} of the page before no longer in the files")
    if (was := before.get("verdict")) != now.verdict:
        said.append(f"Verdict before: {was}")
    said += _levels(before.get("levels", {}), now)
    said += _moved(before, now.describe()) if new else []
    return said + surfaced(before.get("forecast"), now.legs)[:1]


def _dives(new: list[int]) -> str:
    if not new:
        return "No new dive"
    if len(new) == 1:
        return f"1 new dive, {new[0]}"
    return f"{len(new)} new dives, {min(new)} to {max(new)}"


def _levels(before: Mapping[str, Any], now: Morning) -> list[str]:
    """Channels that have moved."""
    if now.health is None:
        return []
    said = []
    for k, channel in enumerate(CHANNELS):
        was = before.get(channel.name)
        level, deviation = (
            float(getattr(now.health.levels, name)[-1, k]) for name in ("level", "deviation")
        )
        if was is None or channel.name in now.health.lacking:
            continue
        step = level - was["level"]
        if abs(step) > MOVED * math.hypot(deviation, was["deviation"]):
            unit = "" if channel.unit == "1" else f" {channel.unit}"
            first, then = apart(was["level"], level)
            said.append(f"{channel.name} ({channel.says}) went from {first} to {then}{unit}")
    return said


def apart(first: float, then: float) -> tuple[str, str]:
    """Two numbers by as many digits, three and more, as tell them apart."""
    for digits in range(3, 9):
        texts = f"{first:.{digits}g}", f"{then:.{digits}g}"
        if texts[0] != texts[1]:
            break
    return texts


def _moved(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Power, days left and current, before and now."""
    said = []
    if before.get("energy") and now["energy"]:
        powers = [one["energy"]["power_w"] for one in (before, now)]
        said.append(f"Power so far went from {powers[0]:.2f} to {powers[1]:.2f} W")
        if before.get("days_left") is not None and now["days_left"] is not None:
            days = before["days_left"], now["days_left"]
            said[-1] += f", the days left from {days[0]:.1f} to {days[1]:.1f}"
    if before.get("current") and now["current"]:
        (north, east), then = now["current"], before["current"]
        step = math.hypot(north - then[0], east - then[1])
        said.append(f"The current of the last dive differs by {step:.2f} m/s from that before")
    return said


def surfaced(foretold: Mapping[str, Any] | None, legs: Sequence[LoggedLeg]) -> list[str]:
    """Surfacings that a page foretold, beside where and when they were: the first one beside the
    first that came, and so on, however far apart.

    Args:
      foretold: the forecast in `latest.json`; None: there was none.
      legs: of the deployment, those after the forecast began among them.
    """
    if not foretold or not foretold["surfacings"]:
        return []
    begin = datetime.datetime.fromisoformat(foretold["start"]["time"]).replace(tzinfo=datetime.UTC)
    after = [one for one in legs if one.leg.end > begin.timestamp() + MINUTE]
    return [_beside(told, came) for told, came in zip(foretold["surfacings"], after, strict=False)]


def _beside(told: Mapping[str, Any], leg: LoggedLeg) -> str:
    """One surfacing as it was foretold and as it was."""
    latitude, longitude = leg.end
    away = great_circle(latitude, longitude, told["latitude"], told["longitude"])
    ellipse = told["ellipse_90"]
    north, east = offset(
        np.array([latitude]), np.array([longitude]), told["latitude"], told["longitude"]
    )
    turn = math.radians(ellipse["bearing_deg"])
    along = float(north[0]) * math.cos(turn) + float(east[0]) * math.sin(turn)
    across = -float(north[0]) * math.sin(turn) + float(east[0]) * math.cos(turn)
    inside = math.hypot(along / ellipse["semi_major_m"], across / ellipse["semi_minor_m"]) <= 1.0
    begin = datetime.datetime.fromisoformat(told["time"]).replace(tzinfo=datetime.UTC)
    minutes = (leg.leg.end - begin.timestamp()) / MINUTE
    return (
        f"Surfacing foretold for {utc_minute(begin.timestamp())} UTC: it came up "
        f"{utc_minute(leg.leg.end)}, {abs(minutes):.0f} min "
        f"{'later' if minutes > 0 else 'earlier'}, {away / 1e3:.2f} km away, "
        f"{'inside' if inside else 'outside'} the 90 % ellipse"
    )
