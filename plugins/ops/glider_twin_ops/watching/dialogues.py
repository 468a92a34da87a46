"""Dialogues: fix, voltages and reasons that a vehicle sends at the surface, before its data.

A dockserver keeps a Slocum's console as `*.log`. A dialogue begins with the vehicle's name; later
dialogues of one surface interval have newer values. A position is degrees and minutes in one
number; times are UTC. The lines are those that the public readers sfmc-api and gncutils read:
`GPS Location:`, `Curr Time:`, `sensor:NAME(UNIT)=VALUE AGE secs ago`, `Because:`, `ABORT HISTORY:`.

A Seaglider calls its base station, which keeps every call in `comm.log`. A call begins with
`Connected at`. A counter line follows, numbers with colons between: dive, calls, errors, pitch,
depth, voltages, and the pressure and humidity inside the hull. The fix stands behind the counters:
`GPS,ddmmyy,hhmmss,latitude,longitude,...`, degrees and minutes in one number, UTC. `EOP_CODE` says
why a dive ended, `RECOV_CODE` why the vehicle stays up. The counters' order is that of the public
package basestation3 for vehicle software from 66.09 on; from older software only the dive's number
is read.
"""

from __future__ import annotations

import datetime
import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path

from glider_twin_ops.watching.sources import SurfaceDialogue
from twin.bounded import check_regular
from twin.errors import OddFile

MOST = 20 * 2**20
"""[byte] Length of a file's end that is read"""
OLD = 86400.0
"""[s] Age from which a value no longer describes this surfacing"""
NAME = re.compile(r"Vehicle Name:\s*(\S+)")
TIME = re.compile(r"Curr Time:\s+\w{3}\s+(\w{3}\s+\d+\s+[\d:]{8}\s+\d{4})")
FIX = re.compile(r"GPS Location:\s+(-?[\d.]+)\s+N\s+(-?[\d.]+)\s+E\s+measured\s+(\S+)\s+secs")
SENSOR = re.compile(r"sensor:(\w+)\(([^)]*)\)=(\S+)\s+(\S+)\s+secs ago")
WHY = re.compile(r"Because:\s*(.+?)\s*$", re.MULTILINE)
ABORTS = re.compile(r"ABORT HISTORY: total since reset:\s*(\d+)")


def read_dialogues(paths: Sequence[Path]) -> list[SurfaceDialogue]:
    """Read every surfacing in console logs."""
    told = (_surfacing(part) for path in paths for part in _parts(last_text(path), NAME))
    return [one for one in told if one is not None]


def last_text(path: Path) -> str:
    """Last `MOST` bytes of a log as text; empty if the log cannot be read now."""
    try:
        check_regular(path)
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - MOST, 0))
            return file.read().decode("latin-1")  # a console log may hold any byte
    except (OddFile, OSError):
        return ""  # a file that is being written, or is gone, is left to a later pass


def _parts(text: str, begin: re.Pattern[str]) -> list[str]:
    """Split a text at each match of a pattern."""
    begins = [one.start() for one in begin.finditer(text)]
    return [text[a:b] for a, b in itertools.pairwise([*begins, len(text)])]


def _surfacing(text: str) -> SurfaceDialogue | None:
    name, moment = NAME.search(text), TIME.search(text)
    time = _clock(" ".join(moment[1].split()), ["%b %d %H:%M:%S %Y"]) if moment else None
    if name is None or time is None:
        return None
    fix = fix_time = None
    if (place := FIX.search(text)) is not None and (ago := _number(place[3])) is not None:
        fix = _place(place[1], place[2]) if ago < OLD else None
        fix_time = None if fix is None else time - ago
    sensors = {}
    for sensor, unit, value, age in SENSOR.findall(text):
        number, since = _number(value), _number(age)
        if number is not None and since is not None and since < OLD:
            sensors[sensor] = (number, unit)
    why, aborts = WHY.search(text), ABORTS.search(text)
    return SurfaceDialogue(
        vehicle=name[1],
        time=time,
        fix=fix,
        fix_time=fix_time,
        sensors=sensors,
        why="" if why is None else why[1],
        aborts=None if aborts is None else int(aborts[1]),
    )


def _number(word: str) -> float | None:
    """Convert a word to a number; None if the word is no number."""
    try:
        return float(word)
    except ValueError:
        return None


def _place(*words: str) -> tuple[float, float] | None:
    """Latitude and longitude [degree] of words such as -11741.800, degrees and minutes in one
    number; None if the words are no place."""
    values = [value for value in map(_number, words) if value is not None]
    if len(values) < len(words):
        return None
    latitude, longitude = (int(x / 100.0) + math.fmod(x, 100.0) / 60.0 for x in values)
    return (latitude, longitude) if abs(latitude) <= 90.0 and abs(longitude) <= 180.0 else None


def _clock(text: str, forms: Sequence[str]) -> float | None:
    """[s] Unix time of a UTC time in the first form that fits; None if no form fits."""
    for form in forms:
        try:
            moment = datetime.datetime.strptime(text, form)
        except ValueError:
            continue
        return moment.replace(tzinfo=datetime.UTC).timestamp()
    return None


CALL = re.compile(r"^Connected at (.+)$", re.MULTILINE)
VEHICLE = re.compile(r"[(\[](sg\d+)[)\]]", re.IGNORECASE)
COUNTERS = re.compile(r"^(-?\d+(?::-?[\d.]+){3,})(?: (.*))?$", re.MULTILINE)
CALL_FIX = re.compile(r"GPS,(\d{6}),(\d{6}),(-?[\d.]+),(-?[\d.]+),(?:-?[\d.]+,(-?[\d.]+),)?")
"""Pattern of a fix; group 5 is the dilution of precision, behind the seconds to the first fix"""
NO_DILUTION = 99.0
"""Smallest dilution that means no fix: receivers without a fix write 99 or 99.9"""
CODES = {
    "dive ended by": re.compile(r"^EOP_CODE=(\w+)", re.MULTILINE),
    "stays up by": re.compile(r"^RECOV_CODE=(\w+)", re.MULTILINE),
}
NO_REASON = ("CONTROL_FINISHED_OK", "NO_RECOVERY_REASON")
"""Codes of a dive that ended as planned"""
FIRST = {"dive": (0, ""), "reboots": (5, ""), "pitch": (10, "degree"), "depth": (11, "m")}
"""Place and unit of each value in a counter line that has voltages"""
BEHIND = {16: 12, 17: 13, 20: 13}
"""Place of the first voltage, by the number of counters in the line"""
UNITS = {"battery_10V": "V", "battery_24V": "V", "internal_pressure": "psi", "humidity": "%"}
"""Values from the place in BEHIND on, in order, with their units"""
CLOCKS = ("%Y-%m-%dT%H:%M:%SZ", "%a %b %d %H:%M:%S UTC %Y", "%a %b %d %H:%M:%S GMT %Y")
"""Forms of a base station's time; if no form fits, as in another zone, the fix gives the time"""


def read_calls(paths: Sequence[Path]) -> list[SurfaceDialogue]:
    """Read every call in which the vehicle sent its counters."""
    found: list[SurfaceDialogue] = []
    for path in paths:
        text = last_text(path)
        named = VEHICLE.search(text)
        calls = (_call(part, named[1] if named else "") for part in _parts(text, CALL))
        found += [one for one in calls if one is not None]
    return found


def _call(text: str, vehicle: str) -> SurfaceDialogue | None:
    """Read one call; None without counters or without a time."""
    connected, counters = CALL.search(text), COUNTERS.search(text)
    if connected is None or counters is None:
        return None
    own = VEHICLE.search(text)
    fix, fix_time = _fix(counters[2] or "")
    time = _clock(connected[1].partition(" (")[0].strip(), CLOCKS)
    time = fix_time if time is None else time
    if time is None:
        return None
    said = {word: code[1] for word, one in CODES.items() if (code := one.search(text))}
    return SurfaceDialogue(
        vehicle=own[1] if own else vehicle,
        time=time,
        fix=fix,
        fix_time=fix_time,
        sensors=_sensors(counters[1].split(":")),
        why=", ".join(f"{word} {code}" for word, code in said.items() if code not in NO_REASON),
        aborts=None,
    )


def _sensors(counters: Sequence[str]) -> dict[str, tuple[float, str]]:
    every = {"dive": FIRST["dive"]}
    if (behind := BEHIND.get(len(counters))) is not None:
        every = FIRST | {name: (k, UNITS[name]) for k, name in enumerate(UNITS, behind)}
    values = {name: (_number(counters[place]), unit) for name, (place, unit) in every.items()}
    return {name: (value, unit) for name, (value, unit) in values.items() if value is not None}


def _fix(text: str) -> tuple[tuple[float, float] | None, float | None]:
    """Fix in a line: latitude and longitude [degree], and time [s] unix; None, None without one."""
    found = CALL_FIX.search(text)
    if found is None or (_number(found[5] or "") or 0.0) >= NO_DILUTION:  # the receiver had no fix
        return None, None
    place, time = _place(found[3], found[4]), _clock(found[1] + found[2], ["%d%m%y%H%M%S"])
    return (None, None) if place is None or time is None else (place, time)
