"""docs/reference/missions.md is true: its example flies, its code runs, its tables are complete."""

import dataclasses
import re
from pathlib import Path

import pytest

from twin.mission import Mission, mission_names
from twin.mission.segments import SEGMENTS
from twin.vehicle.vehicle import load_vehicle

PAGE = (Path(__file__).parents[3] / "docs" / "reference" / "missions.md").read_text(
    encoding="utf-8"
)


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_toml_example_can_be_flown(tmp_path):
    texts, kinds = blocks("toml"), [["saw-tooth", "spiral", "surface"], ["waypoint"]]
    for text, expected in zip(texts, kinds, strict=True):
        path = tmp_path / "example.toml"
        path.write_text(text, encoding="utf-8")
        mission = Mission.from_toml(path)
        mission.check(load_vehicle("glider"))
        assert [segment.kind for segment in mission.segments] == expected


def test_python_examples_run():
    names = {}
    for block in blocks("python"):
        exec(compile(block, "docs/reference/missions.md", "exec"), names)
    assert names["run"].complete


def test_every_kind_of_segment_is_described():
    described = set(re.findall(r"\*\*`([\w-]+)`\*\*", PAGE))
    assert described == set(SEGMENTS.shipped())


@pytest.mark.parametrize("cls", [Mission, *(SEGMENTS[kind] for kind in SEGMENTS.shipped())])
def test_every_key_is_in_the_tables(cls):
    rows = [line for line in PAGE.splitlines() if line.startswith("| `")]
    keys = {key for row in rows for key in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert {field.name for field in dataclasses.fields(cls)} <= keys


def test_shipped_missions_are_named():
    assert all(f"`{name}`" in PAGE for name in mission_names())
