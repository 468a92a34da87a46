"""Seaglider targets: the file `targets` that a Seaglider fetches when it calls.

A line for each place: its name, then `lat=` and `lon=` as DDMM.mmmm, north and east positive,
`radius=` [m] at which it is reached, and `goto=` the name of the next one; lines that begin with a
slash are comments (Seaglider File Formats Manual, School of Oceanography and Applied Physics
Laboratory, University of Washington, v66.12).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from twin.bounded import read_text
from twin.errors import MissionError
from twin.mission import Mission, degrees, degrees_minutes, waypoints_of

TARGETS = "targets"
KEYS = ("lat", "lon", "radius", "goto")
OPTIONAL = ("escape", "depth", "finish", "timeout")
"""Keys that say when a target is given up, or reached by depth or by a line: kept out"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SeagliderTarget:
    """One place."""

    name: str
    latitude: float
    """[degree]"""
    longitude: float
    """[degree]"""
    radius_m: float
    goto: str
    """Name of the next one; its own where it stays"""


def targets_of(mission: Mission) -> tuple[SeagliderTarget, ...]:
    """The places of a mission to waypoints, T1, T2, ...; it stays at the last.

    Raises:
      MissionError: another kind of mission, or places that are given from the start.
    """
    segment = waypoints_of(mission, "targets of a Seaglider")
    count = len(segment.targets)
    return tuple(
        SeagliderTarget(
            name=f"T{k}",
            latitude=target["latitude"],
            longitude=target["longitude"],
            radius_m=segment.arrival_radius_m,
            goto=f"T{min(k + 1, count)}",
        )
        for k, target in enumerate(segment.targets, start=1)
    )


def targets_text(targets: Sequence[SeagliderTarget]) -> str:
    """The text of the file."""
    return "".join(
        f"{one.name} lat={degrees_minutes(one.latitude)} lon={degrees_minutes(one.longitude)} "
        f"radius={one.radius_m:.0f} goto={one.goto}\n"
        for one in targets
    )


def radius_of(targets: Sequence[SeagliderTarget]) -> float:
    """[m] of arrival, where all have the same.

    Raises:
      MissionError: they have not.
    """
    found = sorted({one.radius_m for one in targets})
    if len(found) != 1:
        raise MissionError(
            f"targets have the radii {', '.join(f'{one:g}' for one in found)}: a mission has one"
        )
    return found[0]


def read_targets(path: str | Path) -> tuple[SeagliderTarget, ...]:
    """The places of a file, in its order.

    Raises:
      MissionError: it cannot be read, a line lacks a key or has one that is not known, a place is
        no DDMM.mmmm, or `goto` names no place of the file.
    """
    path = Path(path)
    found: list[SeagliderTarget] = []
    for number, line in enumerate(read_text(path, "targets", MissionError).splitlines(), start=1):
        said = line.strip()
        if not said or said.startswith("/"):
            continue
        found.append(_target(f"{path.name} line {number}", said))
    if not found:
        raise MissionError(f"{path.name} has no target: a line is NAME lat= lon= radius= goto=")
    names = [one.name for one in found]
    for one in found:
        if one.goto not in names:
            raise MissionError(f"{path.name}: {one.name} goes to {one.goto}, which is not in it")
    return tuple(found)


def _target(where: str, line: str) -> SeagliderTarget:
    name, *words = line.replace("= ", "=").split()
    values = dict(word.partition("=")[::2] for word in words)
    for key in values:
        if key not in KEYS + OPTIONAL:
            raise MissionError(f"{where}: {key!r} is not one of {', '.join(KEYS + OPTIONAL)}")
    for key in KEYS:
        if not values.get(key):
            raise MissionError(f"{where}: {name} has no {key}=")
    try:
        radius = float(values["radius"])
    except ValueError:
        raise MissionError(f"{where}: radius={values['radius']} must be metres") from None
    latitude, longitude = (degrees(where, values[key]) for key in ("lat", "lon"))
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        raise MissionError(f"{where}: latitude {latitude:g}, longitude {longitude:g} is no place")
    return SeagliderTarget(
        name=name, latitude=latitude, longitude=longitude, radius_m=radius, goto=values["goto"]
    )
