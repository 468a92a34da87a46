"""docs/reference/currents.md is true: names, units and defaults are the code's, examples run."""

import ast
import dataclasses
import inspect
import re
import textwrap
from pathlib import Path

from examples import script

from twin.seams import CURRENTS
from twin.water.current import (
    Origin,
    TidalEllipse,
    Uniform,
    axes,
    current_help,
    parse_current,
)
from twin.water.current import velocity_file as files
from twin.water.current.profile import COLUMNS
from twin.water.current.sampler import kinds
from twin.water.current.tide import ELLIPSE_SETTINGS, PERIOD_HOURS

PAGE = (Path(__file__).parents[3] / "docs" / "reference" / "currents.md").read_text(
    encoding="utf-8"
)
KINDS = {kind.kind: kind for kind in kinds()}


def rows(heading: str) -> dict[tuple[str, ...], list[str]]:
    """Unit and other cells of a section's first table, by the names of the first cell."""
    section = re.split(rf"^##+ `?{re.escape(heading)}`?$", PAGE, flags=re.MULTILINE)[1]
    section = re.split(r"^## ", section, flags=re.MULTILINE)[0]
    lines = [line for line in section.splitlines() if line.startswith("| `")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {
        tuple(re.findall(r"`([^`]+)`", first)): [first.partition("[")[2].rstrip("]"), *rest]
        for first, *rest in cells
    }


def units(cls: type) -> dict[str, str]:
    """The unit in brackets that begins the docstring of each field."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    assert isinstance(tree, ast.ClassDef)
    found = {}
    for field, text in zip(tree.body, tree.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
            match = re.match(r"\[(.+?)\]", ast.literal_eval(text.value))
            found[ast.unparse(field.target)] = match[1] if match else ""
    return found


def test_every_setting_has_its_unit_in_the_made_tables():
    made = script("docs_settings")
    sections = made.sections_by_name()
    for kind in KINDS.keys() - set(made.OWN_FORMS):
        found = units(KINDS[kind])
        for name, field in KINDS[kind].setting_fields().items():
            (row,) = [line for line in sections[kind].splitlines() if f"`{name}`" in line[:40]]
            assert f"[{found[field]}]" in row.replace("\\", "") or not found[field], row


def test_tide_settings():
    table = rows("tide")
    constituents = next(iter(table))
    del table[constituents]
    assert {name.upper() for name in constituents} <= set(PERIOD_HOURS)
    assert {names: row[:2] for names, row in table.items()} == {
        (name,): [units(TidalEllipse)[field], "0"] for name, field in ELLIPSE_SETTINGS.items()
    }
    section = PAGE.split("## `tide`")[1].split("\n| ")[0]
    named = set(re.findall(r"`(\w\d)`", section))
    assert {name.upper() for name in named} == set(PERIOD_HOURS)


def test_uniform_settings():
    names = [name for row in rows("uniform") for name in row]
    assert names == ["speed", "direction", *(field.name for field in dataclasses.fields(Uniform))]
    assert parse_current("uniform:speed=0.3,direction=90") == Uniform.toward(0.3, 90.0)


def test_profile_columns():
    assert sorted(name for names in rows("profile") for name in names) == sorted(COLUMNS)
    for names in rows("profile"):
        assert len({COLUMNS[name] for name in names}) == 1


def test_every_kind_has_a_section_and_a_line_of_help():
    sections = re.findall(r"^## `([\w-]+)`$", PAGE, re.MULTILINE)
    helped = {re.split(r"[: ]", line)[0] for line in current_help().splitlines()[:-1]}
    assert len(set(sections)) == len(sections)
    assert set(sections) == helped
    assert set(KINDS) | {"none"} == set(sections)


def test_the_page_has_a_row_for_each_example():
    table = PAGE.split("| example | what |")[1].split("\n\n")[0].splitlines()[2:]
    rows = dict(re.fullmatch(r"\| `(.+?)` \| (.+) \|", line).groups() for line in table)
    assert rows.pop("none") == "still water"
    expected = {}
    for name in CURRENTS.shipped():
        expected.update(CURRENTS[name].usage)
    assert rows == expected


def test_names_that_grids_understand():
    made = script("docs_settings").grid_names()
    for names in (
        *files.STANDARD_NAMES.values(),
        *files.ALIASES.values(),
        *axes.AXIS_NAMES.values(),
    ):
        assert [name for name in names if f"`{name}`" not in made] == []
    assert {"m/s", "cm/s", "mm/s"} <= set(files.SPEED_UNITS)
    assert set(axes.DEPTH_UNITS.values()) == {1.0, 1000.0, 0.01}  # m, km, cm


def test_origin_is_the_documented_one():
    text = " ".join(PAGE.split())
    origin = Origin()
    assert f"latitude {origin.latitude_deg:g}, longitude {origin.longitude_deg:g}" in text
    assert origin.time is None


def test_examples_run():
    commands = re.findall(r"--current (\S+)", PAGE)
    assert len(commands) >= 3
    for text in commands:
        parse_current(text)
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        code = compile(block, "docs/reference/currents.md", "exec", dont_inherit=True)
        exec(code, {"__name__": "docs_currents"})
