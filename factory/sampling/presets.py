"""Presets: named choices of distributions, sensors and missions for `factory generate`.

`read_changes` reads replaced distributions from a TOML file and NAME=VALUE words.
`ReferenceSet` is a recipe with the checksum of every array, which anybody can make again.
The functions `paper_test_*` make the paper's test trajectory in three currents.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.sampling.distribution import Distribution, Value
from factory.sampling.draw import TEST, Parameters, Plan, draw_values
from factory.sampling.mission_kinds import MISSION_KINDS
from factory.sampling.parameters import Table, declared, override
from twin import mission as missions
from twin.bounded import read_toml
from twin.errors import InputError, MissionError, unknown_name
from twin.vehicle.presets import asset_path, assets_folder

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle


@dataclasses.dataclass(frozen=True)
class Preset:
    """Distributions, sensors and missions of a preset."""

    spread: str
    """Column of the table of parameters: paper or field"""
    sensors: str
    """Sensor suite of gliders"""
    survey_sensors: str
    """Sensor suite of vehicles with a propeller"""
    fixed_missions: bool = False
    """True if the missions are given, not sampled"""
    changes: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Distributions that replace those of the column, if the vehicle has the parameter"""

    def distributions(self, table: Table) -> dict[str, Distribution]:
        """Return the distribution of every parameter of a table."""
        own = {name: text for name, text in self.changes.items() if name in table}
        return override(declared(self.spread, table), own)


FAMILY: Mapping[str, str] = {
    # a year's fouling adds half to the drag; a clean hull may have less drag than its file
    "vehicle.k_d0": "uniform(0.7, 1.6)",
    "vehicle.k_d": "uniform(0.7, 1.6)",
    "vehicle.k_alpha": "uniform(0.8, 1.25)",
    # several dives make the vehicle's state observable
    "mission.duration_h": "uniform(2, 6)",
}
"""Changes of preset `family`: vehicles that differ widely from their file"""


ROV: Mapping[str, str] = {"current.speed": "uniform(0, 0.8)"}
"""Changes of preset `rov`: currents up to the vehicle's own speed"""


PRESETS: Mapping[str, Preset] = {
    "paper": Preset("paper", "ideal", "survey"),
    "field": Preset("field", "field", "survey-field"),
    "family": Preset("field", "field", "survey-field", changes=FAMILY),
    "rov": Preset("field", "survey-field", "survey-field", changes=ROV),
    "paper-test": Preset("paper", "ideal", "survey", fixed_missions=True),
}
"""`paper`: a glider with ideal sensors in one constant current per mission; a propelled vehicle
in still water with the instruments of the paper's tables. `field` adds the paper's list of further
work: sensor errors, GPS fixes, currents that vary with depth, and vehicles that differ from their
file. `rov`: as field, with the instruments of a survey and currents up to an ROV's speed. `family`:
as field, with fouled or clean vehicles far from their file, in longer missions.
`paper-test`: the paper's test trajectory in three currents."""


def read_changes(path: Path | None, words: Sequence[str] = ()) -> dict[str, str | float]:
    """Read replaced distributions by parameter name; words take precedence over the file.

    The file holds tables named after the groups:

        [mission]
        pitch_deg = "uniform(15, 35)"

    Raises:
      InputError: the file cannot be read or is not TOML of this form, or a word has no =.
    """
    changes = {} if path is None else _read_file(path)
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name.strip() or not value.strip():
            raise InputError(
                f"--set {word!r}: write NAME=DISTRIBUTION, such as "
                "mission.pitch_deg='uniform(15, 35)'"
            )
        changes[name.strip()] = value.strip()
    return changes


def _read_file(path: Path) -> dict[str, str | float]:
    changes: dict[str, str | float] = {}
    for group, table in read_toml(path, "parameter file").items():
        if not isinstance(table, Mapping):
            raise InputError(f"{path}: {group} must be a table, such as [mission]")
        for name, value in table.items():
            if isinstance(value, bool) or not isinstance(value, str | int | float):
                raise InputError(f"{path}: {group}.{name} = {value!r}: give a number or a text")
            changes[f"{group}.{name}"] = value
    return changes


FOLDER = "reference"
"""Folder of the reference sets in `assets/`"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReferenceSet:
    """Recipe with the checksums of the arrays that it makes."""

    name: str
    """Name that the user types"""
    preset: str
    """Preset of `factory generate`"""
    hours: float
    """[h] Simulated time of all missions together"""
    seed: int
    """Root of every random draw"""
    physics: int
    """Version of the physics that made the checksums"""
    arrays: Mapping[str, str]
    """SHA-256 of each array's type, shape and values, by name, from `array_checksums`"""

    def differences(self, found: Mapping[str, str]) -> dict[str, str]:
        """Describe each array that differs from the list, by name; empty if all agree."""
        wrong = dict.fromkeys(self.arrays.keys() - found.keys(), "is missing")
        wrong |= dict.fromkeys(found.keys() - self.arrays.keys(), "is not listed")
        both = found.keys() & self.arrays.keys()
        wrong |= {name: "has other values" for name in both if found[name] != self.arrays[name]}
        return dict(sorted(wrong.items()))


def reference_names() -> tuple[str, ...]:
    """Names of the shipped reference sets."""
    return tuple(sorted(path.stem for path in (assets_folder() / FOLDER).glob("*.json")))


def reference_set(name: str) -> ReferenceSet:
    """Load the shipped reference set `name`.

    Raises:
        InputError: there is no such set.
    """
    names = reference_names()
    if name not in names:
        raise InputError(unknown_name("reference set", name, names))
    return ReferenceSet(name=name, **json.loads(asset_path(f"{FOLDER}/{name}.json").read_text()))


MISSION_NAME = "spiral-level-spiral"
CURRENTS: Mapping[str, tuple[float, float]] = {
    "low": (-0.05, -0.002),
    "medium": (-0.12, 0.09),
    "strong": (-0.18, 0.24),
}
"""[m/s] North, east: speeds 0.05 (as printed; we read u_c, v_c as north, east), 0.15 and 0.30"""


def paper_test_plan() -> Plan:
    """Plan of three missions, all in split test."""
    duration = missions.load_mission(MISSION_NAME).duration_s
    assert duration is not None
    return Plan(durations_s=(duration,) * len(CURRENTS), splits=(TEST,) * len(CURRENTS))


def check_paper_test(vehicle: Vehicle) -> None:
    """Raise InputError if the vehicle cannot fly the paper's mission."""
    try:
        missions.load_mission(MISSION_NAME).compile(vehicle)
    except MissionError as error:
        raise InputError(
            f"preset 'paper-test' flies the mission of a glider, {MISSION_NAME}, and {error}; "
            "choose preset paper or field"
        ) from error


def paper_test_parameters(
    index: int,
    table: Table,
    distributions: Mapping[str, Distribution],
    changed: Collection[str],
    *,
    seed: int,
    attempt: int,
) -> Parameters:
    """Return the parameters of mission `index` of the three.

    Parameters in `changed`, which a user replaced, take precedence over the test's own.
    """
    mission = missions.load_mission(MISSION_NAME)
    assert mission.duration_s is not None
    north, east = list(CURRENTS.values())[index]
    own: dict[str, Value] = {
        "mission.start_heading_deg": mission.start_heading_deg,
        "current.speed": math.hypot(north, east),
        "current.steady_direction_deg": math.degrees(math.atan2(east, north)) % 360.0,
    }
    values = draw_values(table, distributions, seed=seed, mission=index, attempt=attempt)
    values |= {name: value for name, value in own.items() if name not in changed}
    segments = tuple(_segments(mission, table))
    return Parameters(duration_s=mission.duration_s, values=values, segments=segments)


def _segments(mission: missions.Mission, table: Table) -> list[Mapping[str, Value]]:
    """Convert the segments of a mission to parameters of the table."""
    rows: list[Mapping[str, Value]] = []
    heading = mission.start_heading_deg
    for segment in mission.segments:
        assert segment.kind in MISSION_KINDS
        row: dict[str, Value] = {n: math.nan for n, p in table.items() if p.per_segment}
        row["mission.kind"] = segment.kind
        said = {field.name: getattr(segment, field.name) for field in dataclasses.fields(segment)}
        said["segment_duration_s"] = said.pop("duration_s")
        if not isinstance(segment, missions.Spiral):
            said["heading_change_deg"] = said["heading_deg"] - heading
            heading = said["heading_deg"]
        for name, value in said.items():
            if value is None and name.startswith("climb_"):
                value = said[name.removeprefix("climb_")]
            if f"mission.{name}" in row and value is not None:
                row[f"mission.{name}"] = float(value)
        rows.append(row)
    return rows
