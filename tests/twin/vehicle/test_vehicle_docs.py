"""docs/physics/equations.md names every shipped hull law and part and what its file says."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from twin.vehicle.laws import LAWS
from twin.vehicle.parts import PARTS, Part

PAGE = (Path(__file__).parents[3] / "docs" / "physics" / "equations.md").read_text(encoding="utf-8")


def table(header):
    """Rows of the table whose header begins so: the rest of each by its first cell."""
    lines = iter(PAGE[PAGE.index(header) :].splitlines()[2:])
    rows = {}
    for line in lines:
        if not line.startswith("|"):
            return rows
        name, _, rest = line.strip("| ").partition("|")
        rows[name.strip().strip("`")] = rest
    return rows


def test_every_law_has_a_row():
    assert tuple(table("| `hull_law` |")) == LAWS.shipped()


@pytest.mark.parametrize("kind", PARTS.shipped())
def test_every_part_has_a_row_with_its_unit_and_numbers(kind):
    rows = table("| kind | position |")
    assert tuple(rows) == PARTS.shipped()
    part = PARTS[kind]
    assert part.unit == "1" or part.unit in rows[kind].split("|")[0]
    own = {field.name for field in dataclasses.fields(part)}
    own -= {field.name for field in dataclasses.fields(Part)}
    assert [name for name in own if f"`{name}`" not in rows[kind]] == []


def test_the_flow_frame_laws_numbers_are_named():
    row = table("| `hull_law` |")["flow-frame"]
    names = [field.name for field in dataclasses.fields(LAWS["flow-frame"])]
    assert [name for name in names if f"`{name}`" not in row] == []
