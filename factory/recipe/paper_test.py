"""Paper test: the paper's test trajectory in three currents.

The paper's test mission lasts 10 000 s and combines two spirals and a wings-level part; the
settings are those of the shipped mission `spiral-level-spiral`, which no training mission of
preset `paper` of the shipped gliders commands (see the exclusions in
`factory.recipe.parameters` and in their files). The low current is the
paper's; medium and strong are ours, since it only says that they are stronger.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import fields

from factory.recipe.distribution import Distribution, Value
from factory.recipe.kinds import MISSION_KINDS
from factory.recipe.parameters import Table
from factory.recipe.plan import TEST, Plan
from factory.recipe.sampling import Parameters, draw_values
from twin.errors import InputError, MissionError
from twin.mission import Mission, Spiral, load_mission
from twin.mission.segments import Profile
from twin.vehicle.vehicle import Vehicle

MISSION_NAME = "spiral-level-spiral"
CURRENTS: Mapping[str, tuple[float, float]] = {
    "low": (-0.05, -0.002),
    "medium": (-0.12, 0.09),
    "strong": (-0.18, 0.24),
}
"""North, east [m/s]: 0.05 as printed (north and east are our reading of u_c, v_c), 0.15, 0.30."""


def paper_test_plan() -> Plan:
    """Three missions, all in split test."""
    duration = load_mission(MISSION_NAME).duration_s
    assert duration is not None
    return Plan(durations_s=(duration,) * len(CURRENTS), splits=(TEST,) * len(CURRENTS))


def check_paper_test(vehicle: Vehicle) -> None:
    """Raise InputError when the vehicle cannot fly the paper's mission."""
    try:
        load_mission(MISSION_NAME).compile(vehicle)
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
    """Mission `index` of the three.

    `changed` names the parameters that a user replaced; they win over the test's own.
    """
    mission = load_mission(MISSION_NAME)
    assert mission.duration_s is not None
    north, east = list(CURRENTS.values())[index]
    own: dict[str, Value] = {
        "mission.start_heading_deg": mission.start_heading_deg,
        "current.speed": math.hypot(north, east),
        "current.steady_direction_deg": math.degrees(math.atan2(east, north)) % 360.0,
    }
    values = draw_values(table, distributions, seed=seed, mission=index, attempt=attempt)
    values |= {name: value for name, value in own.items() if name not in changed}
    return Parameters(
        duration_s=mission.duration_s, values=values, segments=tuple(_segments(mission, table))
    )


def _segments(mission: Mission, table: Table) -> list[Mapping[str, Value]]:
    rows: list[Mapping[str, Value]] = []
    heading = mission.start_heading_deg
    for segment in mission.segments:
        assert isinstance(segment, Profile)
        row: dict[str, Value] = {n: math.nan for n, p in table.items() if p.per_segment}
        assert segment.kind in MISSION_KINDS
        row["mission.kind"] = segment.kind
        for field in fields(Profile):
            name = {"duration_s": "segment_duration_s"}.get(field.name, field.name)
            value = getattr(segment, field.name)
            if value is None and field.name.startswith("climb_"):
                value = getattr(segment, field.name.removeprefix("climb_"))
            if f"mission.{name}" in row and value is not None:
                row[f"mission.{name}"] = float(value)
        if isinstance(segment, Spiral):
            row["mission.rotation_deg"] = float(segment.rotation_deg)
        else:
            target = segment.heading_deg  # type: ignore[attr-defined]
            row["mission.heading_change_deg"] = float(target - heading)
            heading = target
        rows.append(row)
    return rows
