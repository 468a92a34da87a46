"""Surface dialogue: what a Slocum says on its console after it came up, minutes before its data.

A dockserver keeps it as `*.log`. A surfacing begins with the vehicle's name; later ones of the same
stay repeat it with newer values. Positions are degrees and minutes in one number, times UTC. The
lines are those of the public readers sfmc-api and gncutils: `GPS Location:`, `Curr Time:`,
`sensor:NAME(UNIT)=VALUE AGE secs ago`, `Because:`, `ABORT HISTORY:`.
"""

from __future__ import annotations

import dataclasses
import datetime
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from twin.bounded import check_regular
from twin.errors import OddFile

SUFFIX = ".log"
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class SurfaceDialogue:
    """The last of what one vehicle said."""

    vehicle: str
    time: float
    """[s] unix, by its clock"""
    fix: tuple[float, float] | None
    """Latitude, longitude [degree]"""
    fix_time: float | None
    """[s] unix"""
    sensors: Mapping[str, tuple[float, str]]
    """Value and unit by name"""
    why: str
    """Why it came up"""
    aborts: int | None
    """Since it was reset"""

    def facts(self) -> dict[str, str]:
        """Names and values for a page."""
        said = {"why it came up": self.why} if self.why else {}
        if self.aborts is not None:
            said["aborts since its reset"] = f"{self.aborts}"
        return said | {name: f"{v:g} {unit}" for name, (v, unit) in sorted(self.sensors.items())}


def read_dialogue(
    paths: Sequence[Path], *, until: datetime.datetime | None = None
) -> SurfaceDialogue | None:
    """The newest surfacing in the logs of a console; None: there is none in them.

    Args:
      until: only surfacings until then, UTC.
    """
    found: list[SurfaceDialogue] = []
    for path in paths:
        try:
            check_regular(path)
            with path.open("rb") as file:
                file.seek(max(path.stat().st_size - MOST, 0))
                text = file.read().decode("latin-1")  # a console has any bytes
        except (OddFile, OSError):
            continue  # a file that is still being written, or has gone, says it the next time
        found += [one for part in _surfacings(text) if (one := _told(part)) is not None]
    last = None if until is None else until.timestamp()
    known = [one for one in found if last is None or one.time <= last]
    return max(known, key=lambda one: one.time, default=None)


def dialogue_files(source: Path, *, recursive: bool) -> list[Path]:
    """Logs of a console below a folder, in the order of names."""
    every = source.rglob(f"*{SUFFIX}") if recursive else source.glob(f"*{SUFFIX}")
    return sorted(path for path in every if not path.name.startswith("."))


def _surfacings(text: str) -> list[str]:
    begins = [one.start() for one in NAME.finditer(text)]
    return [text[a:b] for a, b in zip(begins, [*begins[1:], len(text)], strict=True)]


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
    if (place := FIX.search(text)) is not None and (ago := _number(place[3])) is not None:
        latitude, longitude = (_degrees(_number(word)) for word in (place[1], place[2]))
        if latitude is not None and longitude is not None and abs(latitude) <= 90.0 and ago < OLD:
            fix, fix_time = (latitude, longitude), time - ago
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
    try:
        return float(word)
    except ValueError:
        return None


def _degrees(value: float | None) -> float | None:
    """Degrees of degrees and minutes, such as -11741.800."""
    if value is None:
        return None
    whole = int(value / 100.0)
    return whole + (value - 100.0 * whole) / 60.0
