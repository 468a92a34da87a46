"""Surface dialogue: what a Slocum says on its console after it came up, minutes before its data.

A dockserver keeps it as `*.log`. A surfacing begins with the vehicle's name; later ones of the same
stay repeat it with newer values. Positions are degrees and minutes in one number, times UTC. The
lines are those of the public readers sfmc-api and gncutils: `GPS Location:`, `Curr Time:`,
`sensor:NAME(UNIT)=VALUE AGE secs ago`, `Because:`, `ABORT HISTORY:`.
"""

from __future__ import annotations

import datetime
import itertools
import re
from collections.abc import Sequence
from pathlib import Path

from glider_twin_ops.watching.sources.base import SurfaceDialogue
from twin.bounded import check_regular
from twin.errors import OddFile

MOST = 20 * 2**20
"""[byte] of a file that are read, its last ones"""
OLD = 86400.0
"""[s] since it was measured, from which a value says nothing of this surfacing"""
NAME = re.compile(r"Vehicle Name:\s*(\S+)")
TIME = re.compile(r"Curr Time:\s+\w{3}\s+(\w{3}\s+\d+\s+[\d:]{8}\s+\d{4})")
FIX = re.compile(r"GPS Location:\s+(-?[\d.]+)\s+N\s+(-?[\d.]+)\s+E\s+measured\s+(\S+)\s+secs")
SENSOR = re.compile(r"sensor:(\w+)\(([^)]*)\)=(\S+)\s+(\S+)\s+secs ago")
WHY = re.compile(r"Because:\s*(.+?)\s*$", re.MULTILINE)
ABORTS = re.compile(r"ABORT HISTORY: total since reset:\s*(\d+)")


def read_dialogues(paths: Sequence[Path]) -> list[SurfaceDialogue]:
    """Every surfacing in the logs of a console."""
    found: list[SurfaceDialogue] = []
    for path in paths:
        text = last_text(path)
        found += [one for part in _surfacings(text) if (one := _told(part)) is not None]
    return found


def last_text(path: Path) -> str:
    """The last `MOST` bytes of a log as text; empty where it cannot be read now."""
    try:
        check_regular(path)
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - MOST, 0))
            return file.read().decode("latin-1")  # a console has any bytes
    except (OddFile, OSError):
        return ""  # a file that is still being written, or has gone, says it the next time


def _surfacings(text: str) -> list[str]:
    begins = [one.start() for one in NAME.finditer(text)]
    return [text[a:b] for a, b in itertools.pairwise([*begins, len(text)])]


def _told(text: str) -> SurfaceDialogue | None:
    name, moment = NAME.search(text), TIME.search(text)
    if name is None or moment is None:
        return None
    try:
        clock = datetime.datetime.strptime(" ".join(moment[1].split()), "%b %d %H:%M:%S %Y")
    except ValueError:
        return None
    time = clock.replace(tzinfo=datetime.UTC).timestamp()
    fix = fix_time = None
    if (place := FIX.search(text)) is not None and (ago := number_of(place[3])) is not None:
        latitude, longitude = (degrees_of(number_of(word)) for word in (place[1], place[2]))
        if latitude is not None and longitude is not None and abs(latitude) <= 90.0 and ago < OLD:
            fix, fix_time = (latitude, longitude), time - ago
    sensors = {}
    for sensor, unit, value, age in SENSOR.findall(text):
        number, since = number_of(value), number_of(age)
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


def number_of(word: str) -> float | None:
    """The number that a word is; None where it is none."""
    try:
        return float(word)
    except ValueError:
        return None


def degrees_of(value: float | None) -> float | None:
    """Degrees of degrees and minutes in one number, such as -11741.800."""
    if value is None:
        return None
    whole = int(value / 100.0)
    return whole + (value - 100.0 * whole) / 60.0
