"""Communications log: every call of a Seaglider to its base station, as `comm.log` has it.

A call begins with `Connected at`. Its counter line has what the vehicle says first, with colons
between: dive, calls, errors, pitch, depth, voltages, pressure and humidity inside; then its fix as
`GPS,ddmmyy,hhmmss,latitude,longitude,...` in degrees and minutes in one number, UTC. `EOP_CODE` and
`RECOV_CODE` say why a dive ended and why it stays up. The order of the counters is that of the
public package basestation3, for the vehicle's software from 66.09 on; earlier ones have fewer, of
which the dive's number alone is taken.
"""

from __future__ import annotations

import datetime
import itertools
import re
from collections.abc import Sequence
from pathlib import Path

from glider_twin_ops.watching.sources.base import SurfaceDialogue
from glider_twin_ops.watching.sources.surface_dialogue import degrees_of, last_text, number_of

CALL = re.compile(r"^Connected at (.+)$", re.MULTILINE)
VEHICLE = re.compile(r"[(\[](sg\d+)[)\]]", re.IGNORECASE)
COUNTERS = re.compile(r"^(-?\d+(?::-?[\d.]+){3,})(?: (.*))?$", re.MULTILINE)
FIX = re.compile(r"GPS,(\d{6}),(\d{6}),(-?[\d.]+),(-?[\d.]+),(?:-?[\d.]+,(-?[\d.]+),)?")
"""Behind the place: seconds to the first fix, and the dilution of precision"""
NO_DILUTION = 99.0
"""Receivers write it, and 99.9, without a fix"""
CODES = {
    "dive ended by": re.compile(r"^EOP_CODE=(\w+)", re.MULTILINE),
    "stays up by": re.compile(r"^RECOV_CODE=(\w+)", re.MULTILINE),
}
NO_REASON = ("CONTROL_FINISHED_OK", "NO_RECOVERY_REASON")
"""Codes of a usual dive"""
FIRST = {
    "dive": (0, ""), "reboots": (5, ""), "pitch": (10, "degree"), "depth": (11, "m"),
}  # fmt: skip
"""Place in the counter line and unit, where it has the voltages"""
LAST = {
    16: {"battery_10V": 12, "battery_24V": 13, "internal_pressure": 14, "humidity": 15},
    17: {"battery_10V": 13, "battery_24V": 14, "internal_pressure": 15, "humidity": 16},
    20: {"battery_10V": 13, "battery_24V": 14, "internal_pressure": 15, "humidity": 16},
}
"""Places of what stands behind, by the number of counters"""
UNITS = {"battery_10V": "V", "battery_24V": "V", "internal_pressure": "psi", "humidity": "%"}
CLOCKS = ("%Y-%m-%dT%H:%M:%SZ", "%a %b %d %H:%M:%S UTC %Y", "%a %b %d %H:%M:%S GMT %Y")
"""Of a base station; one in another zone is not known, and the fix has the time"""


def read_calls(paths: Sequence[Path]) -> list[SurfaceDialogue]:
    """Every call in which the vehicle said something."""
    found: list[SurfaceDialogue] = []
    for path in paths:
        text = last_text(path)
        named = VEHICLE.search(text)
        begins = [one.start() for one in CALL.finditer(text)]
        for begin, end in itertools.pairwise([*begins, len(text)]):
            call = _call(text[begin:end], named[1] if named else "")
            if call is not None:
                found.append(call)
    return found


def _call(text: str, vehicle: str) -> SurfaceDialogue | None:
    """One call; None where it broke off before the vehicle said anything, or has no time."""
    connected, counters = CALL.search(text), COUNTERS.search(text)
    if connected is None or counters is None:
        return None
    own = VEHICLE.search(text)
    fix, fix_time = _fix(counters[2] or "")
    time = _clock(connected[1].partition(" (")[0].strip())
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
    places = LAST.get(len(counters))
    every = {"dive": FIRST["dive"]} if places is None else dict(FIRST)
    every |= {name: (place, UNITS[name]) for name, place in (places or {}).items()}
    values = {name: (number_of(counters[place]), unit) for name, (place, unit) in every.items()}
    return {name: (value, unit) for name, (value, unit) in values.items() if value is not None}


def _fix(text: str) -> tuple[tuple[float, float] | None, float | None]:
    """Latitude, longitude [degree] and [s] unix; None where the line has none."""
    found = FIX.search(text)
    if found is None:
        return None, None
    latitude, longitude = (degrees_of(number_of(word)) for word in (found[3], found[4]))
    try:
        moment = datetime.datetime.strptime(found[1] + found[2], "%d%m%y%H%M%S")
    except ValueError:
        return None, None
    if latitude is None or longitude is None or abs(latitude) > 90.0 or abs(longitude) > 180.0:
        return None, None
    if (number_of(found[5] or "") or 0.0) >= NO_DILUTION:  # the receiver had no fix
        return None, None
    return (latitude, longitude), moment.replace(tzinfo=datetime.UTC).timestamp()


def _clock(text: str) -> float | None:
    """[s] unix; None for a clock that is not in UTC."""
    for form in CLOCKS:
        try:
            moment = datetime.datetime.strptime(text, form)
        except ValueError:
            continue
        return moment.replace(tzinfo=datetime.UTC).timestamp()
    return None
