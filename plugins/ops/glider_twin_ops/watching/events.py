"""Events: what a pilot must know of, and what the dives since the last page changed.

`events.jsonl` has one JSON object a line, by the files and the settings alone: an alarm has the
times of its dives, not that of the pass which found it. What is no longer so, such as a file that
has been sent again, is no longer there.
"""

from __future__ import annotations

import cmath
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.forecast import LoggedLeg
from glider_twin_ops.health import CHANNELS, DeploymentHealth
from glider_twin_ops.watching.log_of_files import LogOfFiles
from glider_twin_ops.watching.morning import Morning
from twin.cli import counted
from twin.geodesy import great_circle, offset
from twin.records import unix_seconds, whole_file
from twin.records.coordinates import utc_minute
from twin.show.style import moment_of

EVENTS = "events.jsonl"
MOVED = 2.0
"""Deviations by which a level must move to be told"""
MINUTE = 60.0


def noticed(log: LogOfFiles, health: DeploymentHealth | None) -> list[dict[str, Any]]:
    """Files that cannot be read or end too early, and an alarm with what it may be instead."""
    said = [("unreadable file", one) for one in log.unreadable]
    said += [("short file", one) for one in log.short]
    said += [("nothing to import", log.missing)] if log.missing else []
    found: list[dict[str, Any]] = [{"event": event, "says": one} for event, one in said]
    if health is not None and health.alarm:
        first = health.kinds[0]
        noticed_at = health.dives.index(health.noticed_dive)
        same = ("kind", "says", "unit", "otherwise", "find_out")
        rounded = {"probability": health.probability, "size": first.size,
                   "size_deviation": first.size_deviation}  # fmt: skip
        found.append(
            {
                "event": "alarm",
                **{name: getattr(first, name) for name in same},
                **{name: round(value, 6) for name, value in rounded.items()},
                **{name: list(getattr(first, name)) for name in ("dives", "channels", "also")},
                "since_dive": health.since_dive,
                "noticed_dive": health.noticed_dive,
                "noticed": f"{moment_of(float(health.time[noticed_at])):%Y-%m-%dT%H:%MZ}",
            }
        )
    return found


def write_events(events: Sequence[dict[str, Any]], folder: Path) -> None:
    """Write `folder/events.jsonl`, empty where nothing was noticed.

    Raises:
      WriteError: the disk refuses.
    """
    text = "".join(json.dumps(event, sort_keys=True) + "\n" for event in events)
    with whole_file(folder / EVENTS) as place:
        place.write_text(text, encoding="utf-8")


def news(before: Mapping[str, Any] | None, now: Morning) -> list[str]:
    """Sentences on what is new.

    Args:
      before: what `latest.json` of the page before said; None: there was none.
    """
    if before is None or before.get("deployment") != now.deployment:
        return []
    known = set(before.get("dives", ()))
    new = [number for number in now.dives if number not in known]
    said = ["No new dive"]
    if new:
        span = f", {min(new)} to {max(new)}" if len(new) > 1 else f", {new[0]}"
        said = [counted(len(new), "new dive") + span]
    if gone := len(known - set(now.dives)):
        said.append(f"{counted(gone, 'dive')} of the page before no longer in the files")
    if (was := before.get("verdict")) != now.verdict:
        said.append(f"Verdict before: {was}")
    said += _levels(before.get("levels", {}), now)
    said += _moved(before, now.describe()) if new else []
    return said + surfaced(before.get("forecast"), now.legs)[:1]


def _levels(before: Mapping[str, Any], now: Morning) -> list[str]:
    """Channels that have moved."""
    if now.health is None:
        return []
    said = []
    levels = now.health.levels
    for k, channel in enumerate(CHANNELS):
        was = before.get(channel.name)
        if was is None or channel.name in now.health.lacking:
            continue
        level, deviation = float(levels.level[-1, k]), float(levels.deviation[-1, k])
        if abs(level - was["level"]) > MOVED * math.hypot(deviation, was["deviation"]):
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
    begin = unix_seconds(foretold["start"]["time"])
    after = [one for one in legs if one.leg.end > begin + MINUTE]
    return [_beside(told, came) for told, came in zip(foretold["surfacings"], after, strict=False)]


def _beside(told: Mapping[str, Any], leg: LoggedLeg) -> str:
    """One surfacing as it was foretold and as it was."""
    latitude, longitude = leg.end
    place = told["latitude"], told["longitude"]
    away = great_circle(latitude, longitude, *place)
    off = offset(np.array([latitude]), np.array([longitude]), *place)
    ellipse = told["ellipse_90"]
    turned = complex(*(float(one[0]) for one in off)) * cmath.rect(
        1.0, -math.radians(ellipse["bearing_deg"])
    )
    scaled = turned.real / ellipse["semi_major_m"], turned.imag / ellipse["semi_minor_m"]
    begin = unix_seconds(told["time"])
    minutes = (leg.leg.end - begin) / MINUTE
    return (
        f"Surfacing foretold for {utc_minute(begin)} UTC: it came up "
        f"{utc_minute(leg.leg.end)}, {abs(minutes):.0f} min "
        f"{'later' if minutes > 0 else 'earlier'}, {away / 1e3:.2f} km away, "
        f"{'inside' if math.hypot(*scaled) <= 1.0 else 'outside'} the 90 % ellipse"
    )
