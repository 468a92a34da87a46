"""Argument files: a mission's behaviors with the arguments that .ma files give them."""

from __future__ import annotations

from pathlib import Path

from twin.errors import MissionError
from twin.mission.slocum.behavior import Behavior, Parsed, parse

STEM = 6
"""Letters of a behavior's name in the name of its files, which have eight before the point"""
FOLDERS = (".", "mafiles", "../mafiles", "../Mafiles", "../MAFILES")
"""Where they are looked for, from the mission file's folder"""


def with_arguments(path: Path) -> Parsed:
    """The behaviors of a mission file; what a .ma file says stands in place of the mission's own.

    Raises:
      MissionError: as `parse`, or a named file is not there or is for another behavior.
    """
    mission = parse(path)
    for behavior in mission.behaviors:
        number = behavior.arguments.pop("args_from_file", -1.0)
        if number < 0.0:
            continue
        name = f"{behavior.name[:STEM]}{int(number):02d}.ma"
        if behavior.name.startswith("sensors_"):
            continue  # switches that move nothing
        found = _find(path.parent, name)
        if found is None:
            if behavior.name == "sample":
                continue  # it moves nothing, as the reading says
            raise MissionError(
                f"{behavior.label}: its arguments are in {name}, which is neither in {path.parent} "
                "nor in a folder mafiles there or beside it"
            )
        file = parse(found)
        _merge(behavior, file, found.name)
        mission.notes += file.notes
    return mission


def _merge(behavior: Behavior, file: Parsed, name: str) -> None:
    own = file.behaviors[0]
    if own.name != behavior.name:
        raise MissionError(
            f"{name} is for the behavior {own.name}, and {behavior.label} names it: give it "
            f"behavior_name={behavior.name}"
        )
    behavior.arguments.update(own.arguments)
    behavior.lines.update(own.lines)
    behavior.places = own.places or behavior.places
    behavior.file = name


def _find(folder: Path, name: str) -> Path | None:
    """The file whatever the case of its name, as DOS has it."""
    for place in FOLDERS:
        try:
            candidates = sorted((folder / place).iterdir())
        except OSError:
            continue
        for candidate in candidates:
            if candidate.name.lower() == name.lower() and candidate.is_file():
                return candidate
    return None
