"""Slocum behavior: text of a Slocum mission file parsed into behaviors with their arguments.

A mission file (.mi) is a stack of `behavior: NAME` blocks with lines `b_arg: NAME(UNIT) VALUE`, and
lines `sensor: NAME(UNIT) VALUE`. An argument file (.ma) has a line `behavior_name=NAME` and its
arguments between `<start:b_arg>` and `<end:b_arg>`. That of a goto_list has waypoints between
`<start:waypoints>` and `<end:waypoints>`, longitude before latitude in DDMM.mmm. `#` begins a
comment (Teledyne Webb Research, Slocum G2 Glider Operators Training Guide, Rev. 06/12).

`surfacings` combines the surface behaviors of a mission.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from pathlib import Path

from twin.bounded import MOST_SETTINGS, read_text
from twin.errors import MissionError

_WORDS = r"\s*(?P<words>.*)$"
"""Pattern of the words after a line's value: pilots write comments, not always after a `#`."""
_VALUE = r"\s*:\s*(\w+)\s*(?:\(([^)]*)\))?\s*(\S+)?" + _WORDS
_ARGUMENT = re.compile("b_arg" + _VALUE, re.IGNORECASE)
_SENSOR = re.compile("sensor" + _VALUE, re.IGNORECASE)
_BEHAVIOR = re.compile(r"behavior\s*:\s*(\w+)" + _WORDS, re.IGNORECASE)
_NAMED = re.compile(r"behavior_name\s*=\s*(\w+)" + _WORDS, re.IGNORECASE)
_BRACKET = re.compile(r"<(start|end):(\w+)>" + _WORDS, re.IGNORECASE)
_COORDINATE = r"([-+]?\d[\d.]*(?:e[-+]?\d+)?)"
_PLACE = re.compile(
    rf"{_COORDINATE}(?:\s*[,;]\s*|\s+){_COORDINATE}(?![\w.]){_WORDS}", re.IGNORECASE
)
_NUMBER = re.compile(r"[\s,;]*[-+]?\.?\d")
"""Start of a number. If a comment after two coordinates begins so, they have decimal commas."""
MINUTES = 60.0
"""Minutes in a degree."""


@dataclasses.dataclass(kw_only=True)
class Behavior:
    """One behavior with its arguments, and with waypoints if it is a goto_list."""

    name: str
    """Name in lower case."""
    file: str
    """Name of the file with the behavior or with its arguments."""
    arguments: dict[str, float] = dataclasses.field(default_factory=dict)
    """Values by argument name, without the unit."""
    lines: dict[str, str] = dataclasses.field(default_factory=dict)
    """File and line of each argument."""
    places: list[tuple[float, float]] = dataclasses.field(default_factory=list)
    """Waypoints: (latitude, longitude) [degree]."""

    @property
    def label(self) -> str:
        """File and name of the behavior, for messages."""
        return f"{self.file}: {self.name}"

    def pitch_deg(self, name: str) -> float:
        """Magnitude [degree] of a pitch argument, which is in radian.

        Raises:
          MissionError: the value is too large for radian.
        """
        value = self.arguments[name]
        if abs(value) >= 0.5 * math.pi:
            raise MissionError(
                f"{self.lines.get(name, self.file)}: {self.name}: {name} = {value:g} is not a "
                f"pitch in radian: write {math.radians(value):.4f} for {value:g} degree"
            )
        return abs(math.degrees(value))


@dataclasses.dataclass(kw_only=True)
class Parsed:
    """Behaviors and sensor settings of one file, and notes on lines that were not understood."""

    behaviors: list[Behavior] = dataclasses.field(default_factory=list)
    sensors: dict[str, float] = dataclasses.field(default_factory=dict)
    notes: list[str] = dataclasses.field(default_factory=list)


def parse(path: Path) -> Parsed:
    """Parse a .mi or .ma file into its behaviors.

    Raises:
      MissionError: the file is unreadable, a value is not a number, or a place not DDMM.mmm.
    """
    found, bracket = Parsed(), ""
    for number, line in _lines(path):
        where = f"{path.name} line {number}"
        current = found.behaviors[-1] if found.behaviors else None
        if match := _BRACKET.match(line):
            bracket = match[2].lower() if match[1].lower() == "start" else ""
        elif match := _BEHAVIOR.match(line) or _NAMED.match(line):
            found.behaviors.append(Behavior(name=match[1].lower(), file=path.name))
        elif bracket == "waypoints" and current is not None:
            match = _PLACE.match(line)
            current.places.append(_place(where, line, match))
        elif match := _SENSOR.match(line):
            found.sensors[match[1].lower()] = _number(where, match[1], match[3])
        elif (match := _ARGUMENT.match(line)) and current is not None:
            current.arguments[match[1].lower()] = _number(where, match[1], match[3])
            current.lines[match[1].lower()] = where
        else:
            found.notes.append(f"{where}: not understood: {line}")
        if match is not None and match["words"]:
            found.notes.append(f"{where}: words are left out: {match['words']}")
    if not found.behaviors:
        raise MissionError(
            f"{path.name} has no behavior: a Slocum mission file (.mi) has lines 'behavior: NAME', "
            "an argument file (.ma) a line 'behavior_name=NAME'"
        )
    return found


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    text = read_text(path, "Slocum mission file", MissionError, most=MOST_SETTINGS)
    for number, line in enumerate(text.splitlines(), start=1):
        said = line.split("#", 1)[0].strip()
        if said:
            yield number, said


def _number(where: str, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise MissionError(f"{where}: {name} = {text or 'nothing'}: give a number")
    return value


def _place(where: str, line: str, match: re.Match[str] | None) -> tuple[float, float]:
    if match is None or _NUMBER.match(match["words"]):
        raise MissionError(
            f"{where}: {line}: give a longitude and a latitude as DDMM.mmm, and words behind a #"
        )
    longitude, latitude = (degrees(where, match[k]) for k in (1, 2))
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        raise MissionError(
            f"{where}: {line}: longitude {longitude:g}, latitude {latitude:g} degree is not a "
            "place: the longitude comes first, as DDMM.mmm"
        )
    return latitude, longitude


def degrees(where: str, text: str | float) -> float:
    """Convert a coordinate from DDMM.mmm, such as -7032.064: 70 degree 32.064 minutes west.

    Raises:
      MissionError: the text is not a number, or its minutes are 60 or more.
    """
    value = _number(where, "coordinate", str(text))
    whole, minutes = divmod(abs(value), 100.0)
    if minutes >= MINUTES:
        raise MissionError(
            f"{where}: {text} has {minutes:g} minutes: coordinates are DDMM.mmm, degrees and "
            "minutes, not decimal degrees"
        )
    return math.copysign(whole + minutes / MINUTES, value)


# values of start_when (Operators Training Guide, beh_args.h)
IMMEDIATELY, STACK_IDLE, PITCH_IDLE, HEADING_IDLE, UPDOWN_IDLE, NEVER = 0, 1, 2, 3, 4, 5
HIT_WAYPOINT, EVERY_SECS, EVERY_SECS_UPDOWN_IDLE, NO_COMMS = 8, 9, 10, 12
QUITS = 0
"""Value of end_action that ends the mission."""
DEFAULT_STAY = 300.0
"""[s] Surface interval if a surfacing does not give its wait for control-C."""
_USED = {"start_when", "when_secs", "keystroke_wait_time", "end_action", "c_use_pitch",
         "c_pitch_value"}  # fmt: skip
NO_EFFECT = {"gps_wait_time", "gps_postfix_wait_time", "printout_cycle_time", "report_all",
             "strobe_on", "force_iridium_use", "when_wpt_dist", "min_time_between_gps_fixes",
             "sensor_input_wait_time"}  # fmt: skip
"""Arguments without effect on the motion: fix, call and printout happen during the stay."""


@dataclasses.dataclass(kw_only=True)
class Surfacings:
    """Conditions that make the vehicle surface, and the time that it stays there."""

    after_s: float | None = None
    """[s] Time under water until it surfaces; None: never by time."""
    when_yo_ends: bool = False
    at_target: bool = False
    first: bool = False
    """True: it stays at the surface before the first dive."""
    stay_s: float = DEFAULT_STAY
    pitch_deg: float | None = None
    """[degree] Magnitude of pitch in the climb to the surface; None: not given."""


def surfacings(behaviors: list[Behavior], notes: list[str]) -> Surfacings:
    """Combine the surface behaviors into one; add what is left out to `notes`."""
    found = Surfacings()
    stays: list[float] = []
    for behavior in behaviors:
        arguments = behavior.arguments
        when = arguments.get("start_when")
        if _add_surfacing(found, behavior, notes):
            stays.append(arguments.get("keystroke_wait_time", DEFAULT_STAY))
        quits = arguments.get("end_action") == QUITS
        if quits and when not in (STACK_IDLE, HEADING_IDLE, NO_COMMS):
            notes.append(f"{behavior.label}: end_action 0 ends the mission there; here it goes on")
        _add_pitch(found, behavior, notes)
        for name in sorted(set(arguments) - _USED - NO_EFFECT):
            notes.append(f"{behavior.label}: {name} = {arguments[name]:g} is left out")
    if stays:
        found.stay_s = stays[0]
        if len(set(stays)) > 1:
            others = ", ".join(f"{stay:g}" for stay in sorted(set(stays) - {stays[0]}))
            notes.append(
                f"surface: all stays last {stays[0]:g} s, the keystroke_wait_time of the first; "
                f"others say {others} s"
            )
    return found


def _add_surfacing(found: Surfacings, behavior: Behavior, notes: list[str]) -> bool:
    """Add one behavior; return True if it surfaces the glider during the mission."""
    arguments = behavior.arguments
    when = arguments.get("start_when", math.nan)
    if when in (EVERY_SECS, EVERY_SECS_UPDOWN_IDLE, NO_COMMS):
        seconds = arguments.get("when_secs", math.nan)
        if not seconds > 0.0:
            notes.append(f"{behavior.label}: start_when {when:g} without when_secs: left out")
            return False
        if when == EVERY_SECS_UPDOWN_IDLE:
            notes.append(f"{behavior.label}: start_when 10 is flown as 9: it does not wait for yos")
        found.after_s = min(seconds, math.inf if found.after_s is None else found.after_s)
    elif when in (PITCH_IDLE, UPDOWN_IDLE):
        found.when_yo_ends = True
    elif when == HIT_WAYPOINT:
        found.at_target = True
    elif when == IMMEDIATELY:
        found.first = True
    elif when in (STACK_IDLE, HEADING_IDLE, NEVER):
        return False  # a mission ends at the surface anyway
    else:
        said = "is missing" if math.isnan(when) else f"{when:g} is not flown"
        notes.append(f"{behavior.label}: start_when {said}: this surfacing is left out")
        return False
    return True


def _add_pitch(found: Surfacings, behavior: Behavior, notes: list[str]) -> None:
    use, value = (behavior.arguments.get(f"c_{name}") for name in ("use_pitch", "pitch_value"))
    if value is None:
        return
    if use not in (None, 3.0):
        notes.append(
            f"{behavior.label}: c_use_pitch {use:g} is left out: only 3, a servo, is flown"
        )
        return
    pitch = behavior.pitch_deg("c_pitch_value")
    if found.pitch_deg is not None and abs(found.pitch_deg - pitch) > 0.05:
        notes.append(
            f"{behavior.label}: c_pitch_value is {pitch:.1f} degree; the ascent keeps the "
            f"{found.pitch_deg:.1f} of the first surface behavior"
        )
        return
    found.pitch_deg = pitch
