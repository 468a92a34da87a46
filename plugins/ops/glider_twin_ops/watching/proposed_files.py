"""Proposed files: a plan as files that a pilot may send to the vehicle. Nothing is sent.

The project's own reader reads them back, and what it finds is what the twin flies. Files of the
same names in the source, which a dockserver or a base station keeps, are what is flown now.
"""

from __future__ import annotations

import dataclasses
import difflib
import tempfile
from collections.abc import Mapping
from pathlib import Path

from glider_twin_ops.files import (
    CMDFILE,
    SCIENCE,
    TARGETS,
    commanded,
    commands_of,
    commands_text,
    read_commands,
    read_science,
    read_targets,
    science_text,
    sparser,
    targets_of,
    targets_text,
)
from twin import Vehicle
from twin.errors import MissionError
from twin.mission import Mission, Waypoint, read_slocum, slocum_arguments

NAMES = ("goto_l10.ma", "yo10.ma", "surfac10.ma", TARGETS, CMDFILE, SCIENCE)
"""Every name that a proposed file can have"""
SLOCUM, SEAGLIDER = "slocum", "seaglider"
WRITTEN = (SLOCUM, SEAGLIDER)
"""Kinds of logs whose vehicle's files are written"""
UNWRITTEN = {
    "seaexplorer": "files of a SeaExplorer are not written: no public text says what its sea.msn "
    "holds, and its plans are made with its maker's program; set there what is said above",
    "": "files of {} vehicles are not written: set it as it is said above",
}
READS_BACK = """behavior: surface
    b_arg: args_from_file(enum) 10
behavior: goto_list
    b_arg: args_from_file(enum) 10
behavior: yo
    b_arg: args_from_file(enum) 10
"""
"""A mission file that takes argument files of number 10"""
MOST_BYTES = 100_000
"""Of a file that is flown now"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ProposedFiles:
    """Files, and what a reader finds in them."""

    files: Mapping[str, str]
    """Texts by the names"""
    mission: Mission
    """What they say, as the twin flies it"""
    changes: Mapping[str, str]
    """Of each that lies in the source, too: lines that go and that come, as `diff -u` has them;
    empty where they are the same"""


def flown_files(folder: Path) -> dict[str, str]:
    """Texts of the files in a source that the vehicle flies by now, by their names."""
    found = {}
    for name in NAMES:
        path = folder / name
        if path.is_file() and path.stat().st_size <= MOST_BYTES:
            found[name] = path.read_text(encoding="utf-8", errors="replace")
    return found


def proposed_files(
    kind: str,
    mission: Mission,
    vehicle: Vehicle,
    flown: Mapping[str, str],
    samples: float = 1.0,
) -> ProposedFiles:
    """A plan as files.

    Args:
      kind: of the logs, such as slocum.
      flown: texts of files that are flown now, by their names.
      samples: part of the samples that a new science file keeps; 1: none is proposed.

    Raises:
      MissionError: files of the kind are not written, or cannot say what the mission asks.
    """
    if kind not in WRITTEN:
        raise MissionError(UNWRITTEN.get(kind, UNWRITTEN[""].format(kind)))
    if kind == SLOCUM:
        files = slocum_arguments(mission)
    else:
        commands = commands_of(mission, vehicle)
        files = {TARGETS: targets_text(targets_of(mission)), CMDFILE: commands_text(commands)}
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        if samples != 1.0:
            files[SCIENCE] = _science(kind, flown, samples, place)
        for file, text in files.items():
            (place / file).write_text(text, encoding="utf-8")
        read = _read_back(kind, vehicle, place)
    return ProposedFiles(
        files=files,
        mission=read,
        changes={
            name: _difference(name, flown[name], text)
            for name, text in files.items()
            if name in flown
        },
    )


def _science(kind: str, flown: Mapping[str, str], samples: float, place: Path) -> str:
    """The science file that is flown now, with a part of its samples."""
    if kind != SEAGLIDER:
        raise MissionError(
            f"samples = {samples:g} in deployment.toml: a Seaglider alone has a science file that "
            f"is written, not a {kind}; set samples = 1"
        )
    if SCIENCE not in flown:
        raise MissionError(
            f"samples = {samples:g} in deployment.toml: the source has no file {SCIENCE} that says "
            "how it samples now; copy it there from the base station"
        )
    (place / SCIENCE).write_text(flown[SCIENCE], encoding="utf-8")
    return science_text(sparser(read_science(place / SCIENCE), samples))


def _read_back(kind: str, vehicle: Vehicle, place: Path) -> Mission:
    """The mission that the project's own reader finds in the files of a folder."""
    if kind == SEAGLIDER:
        if (place / SCIENCE).exists():
            read_science(place / SCIENCE)
        return commanded(read_commands(place / CMDFILE), read_targets(place / TARGETS), vehicle)
    (place / "plan.mi").write_text(READS_BACK, encoding="utf-8")
    mission = read_slocum(place / "plan.mi", above_floor=True).mission
    segments = tuple(  # flown where the water is deeper than the dive
        dataclasses.replace(one, min_altitude_m=None) if isinstance(one, Waypoint) else one
        for one in mission.segments
    )
    return dataclasses.replace(mission, segments=segments)


def _difference(name: str, now: str, new: str) -> str:
    lines = difflib.unified_diff(
        now.splitlines(), new.splitlines(), f"{name}, flown now", f"{name}, proposed", lineterm=""
    )
    return "".join(f"{line}\n" for line in lines)
