"""Changes: sentences on a vehicle's channels of health, and on changes since the page before.

A sentence has a value and unit that a pilot understands, such as "in dives it sinks 1.2 % faster
than identified", instead of the channel's level.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from glider_twin_ops.forecast import LoggedLeg
from glider_twin_ops.health import CHANNELS
from glider_twin_ops.watching.morning import Morning
from twin.cli import counted
from twin.geodesy import great_circle, offset
from twin.identify import identified
from twin.records import unix_seconds
from twin.records.coordinates import utc_minute

MOVED, MINUTE = 2.0, 60.0
"""MOVED: standard deviations by which a reported level moves. MINUTE: [s] length of a minute"""
UNKNOWN = 20.0
"""Ratio of a level's standard deviation to the channel's noise, above which the level is unknown"""


class Phrase(NamedTuple):
    """Sentence on the level of a channel."""

    form: str
    """Text with `{}` for the value, and `{model}` for the flight model that judged"""
    unit: str
    """Text behind the value, or behind the size of a negative value if `below` is given"""
    below: str = ""
    number: Callable[[float], float] = float
    """Function from the level to the value"""


def _faster(level: float) -> float:
    """Convert a level, 1 minus the ratio of model's to log's rate, to the log's excess [%]."""
    return 100.0 * (1.0 / max(1.0 - level, 1e-3) - 1.0)


def _part(level: float) -> float:
    return 100.0 * level


FAST, PLACE = (" % faster", " % slower"), (" mm forward", " mm aft")
SIDE = " degree to starboard", " degree to port"
PHRASES = {
    "rate_dive": Phrase("in dives it sinks {} than {model}", *FAST, _faster),
    "rate_climb": Phrase("in climbs it rises {} than {model}", *FAST, _faster),
    "trim_dive": Phrase("in dives its battery is {} of where the pitch needs it", *PLACE),
    "trim_climb": Phrase("in climbs its battery is {} of where the pitch needs it", *PLACE),
    "roll_dive": Phrase("in dives it rolls {}", *SIDE),
    "roll_climb": Phrase("in climbs it rolls {}", *SIDE),
    "turn_dive": Phrase("in dives it holds its heading with {} of what turns it", " degree"),
    "turn_climb": Phrase("in climbs it holds its heading with {} of what turns it", " degree"),
    "turn_moves": Phrase("what turns it moves by {} an hour", " degree", number=math.exp),
    "heading_error": Phrase("it is {} off its heading in the median", " degree", number=math.exp),
    "pump_rate": Phrase("its pump moves {}", " cm3/s", number=math.exp),
    "pump_work": Phrase("its pump takes {} its work against the sea", " times", number=math.exp),
    "hotel": Phrase("it takes {} while no pump runs", " W"),
    "resistance": Phrase("its voltage drops by {} under load", " V/A", number=math.exp),
    "air": Phrase("pressure over temperature in its hull is {}", " Pa/K", number=math.exp),
    "surface_depth": Phrase("at the surface it shows a depth of {}", " m"),
    "echoes": Phrase("it hears {} the echoes of earlier dives", " times"),
    "temperature_lag": Phrase("its thermistor is {} late", " s"),
    "cell_lag": Phrase("its conductivity is {} later than its temperature", " s"),
    "lock": Phrase("its Doppler log has lock in {} of the samples", " %", number=_part),
    "current_north": Phrase("the current goes {}", " m/s north", " m/s south"),
    "current_east": Phrase("the current goes {}", " m/s east", " m/s west"),
}
"""Sentence of every channel"""
NOISES = {one.name: one.noise for one in CHANNELS}


def model_of(now: Morning) -> str:
    """Name of the flight model, as in sentences after "than"."""
    if now.vehicle is None:
        return "its model"
    return "identified" if identified(now.vehicle) else f"the flight model of {now.vehicle.name}"


def sentence(text: str) -> str:
    """Begin a text with a capital letter."""
    return text[:1].upper() + text[1:]


def _value(phrase: Phrase, text: str) -> str:
    """Text of a value with its unit."""
    if phrase.below and text.startswith("-"):
        return text[1:] + phrase.below
    return text + phrase.unit


def in_words(name: str, level: float, deviation: float, model: str) -> str:
    """Sentence on a channel's level, rounded by its standard deviation; empty if unknown."""
    phrase = PHRASES[name]
    if not (math.isfinite(level) and 0.0 < deviation < UNKNOWN * NOISES[name]):
        return ""
    value = phrase.number(level)
    step = 0.5 * abs(phrase.number(level + deviation) - phrase.number(level - deviation))
    digits = min(max(0, -math.floor(math.log10(max(step, 1e-9)))), 6)
    text = _value(phrase, f"{value:.{digits}f} +- {step:.{digits}f}")
    return phrase.form.format(text, model=model)


def state_in_words(now: Morning) -> dict[str, str]:
    """Sentence on each channel whose level the log determines, by the channel's name."""
    if now.health is None or not now.dives:
        return {}
    levels, model = now.health.levels, model_of(now)
    found = {
        one.name: in_words(
            one.name, float(levels.level[-1, k]), float(levels.deviation[-1, k]), model
        )
        for k, one in enumerate(CHANNELS)
        if one.name not in now.health.lacking
    }
    return {name: said for name, said in found.items() if said}


def news(before: Mapping[str, Any] | None, now: Morning) -> list[str]:
    """Sentences on changes since the page before.

    Args:
      before: `latest.json` of the page before; None without one.
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
    """Sentences on channels whose level moved."""
    if now.health is None:
        return []
    said, levels, model = [], now.health.levels, model_of(now)
    for k, channel in enumerate(CHANNELS):
        if (was := before.get(channel.name)) is None or channel.name in now.health.lacking:
            continue
        level, deviation = float(levels.level[-1, k]), float(levels.deviation[-1, k])
        if abs(level - was["level"]) > MOVED * math.hypot(deviation, was["deviation"]):
            phrase = PHRASES[channel.name]
            numbers = apart(phrase.number(was["level"]), phrase.number(level))
            first, then = (_value(phrase, number) for number in numbers)
            words = sentence(phrase.form.format(then, model=model))
            said.append(f"{words}; on the page before: {first}")
    return said


def apart(first: float, then: float) -> tuple[str, str]:
    """Format two numbers with the fewest digits, three at least, that make them differ."""
    for digits in range(3, 9):
        texts = f"{first:.{digits}g}", f"{then:.{digits}g}"
        if texts[0] != texts[1]:
            break
    return texts


def _moved(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Sentences on power, days left and current, before and now."""
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
    """Compare a page's forecast surfacings with the actual surfacings, in order, however far apart.

    Args:
      foretold: the forecast in `latest.json`; None without one.
      legs: legs of the deployment, also those after the forecast began.
    """
    if not foretold or not foretold["surfacings"]:
        return []
    begin = unix_seconds(foretold["start"]["time"])
    after = [one for one in legs if one.leg.end > begin + MINUTE]
    return [_beside(told, came) for told, came in zip(foretold["surfacings"], after, strict=False)]


def _beside(told: Mapping[str, Any], leg: LoggedLeg) -> str:
    """Compare one forecast surfacing with the actual surfacing."""
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
