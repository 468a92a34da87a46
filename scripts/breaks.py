"""Breaks the project on purpose in ten ways, one after the other, and asks the gate of each.

    python scripts/breaks.py                 # all; 1 when a gate stays silent
    python scripts/breaks.py --only anchor   # those whose name has this word
    python scripts/breaks.py --write         # the table of docs/project/gates.md, without trying

Each break edits one file of this checkout, runs the gate, and puts the file back. So nothing else
may run here meanwhile.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "project" / "gates.md"
BEGIN, END = "<!-- breaks -->", "<!-- end of breaks -->"


@dataclass(frozen=True)
class Break:
    """One change for the worse."""

    name: str
    """What is wrong then"""
    file: str
    before: str
    """A text that stands once in the file"""
    after: str
    gate: tuple[str, ...]
    """The command that must fail, as words of `python`"""


def tests(*places: str) -> tuple[str, ...]:
    """A run of some tests."""
    return ("-m", "pytest", "-n0", "-q", "-x", "-p", "no:cacheprovider", *places)


BREAKS = (
    Break(
        "a sign in the physics",
        "twin/vehicle/laws/flow_frame.py",
        "    m = sb * t1 + cb * t2\n",
        "    m = sb * t1 - cb * t2\n",
        tests("tests/twin/physics/test_invariance.py"),
    ),
    Break(
        "a unit in an exporter",
        "factory/exporting/og1/og1_terms.py",
        '    "DEPTH": "m",\n',
        '    "DEPTH": "cm",\n',
        tests("tests/factory/exporting/test_og1_content.py", "-k", "units"),
    ),
    Break(
        "a dead anchor in a page of the repository",
        "README.md",
        "[tutorials](docs/tutorials/index.md), ",
        "[tutorials](docs/tutorials/index.md#gone), ",
        tests("tests/docs/test_site.py::test_pages_of_the_repository_lead_somewhere"),
    ),
    Break(
        "a kind in its folder that no table has",
        "twin/seams.py",
        '        "dvl": "twin.navigation.estimators.dvl:DvlSteps",\n',
        "",
        tests("tests/test_seams.py::test_every_kind_in_a_seam_s_folder_is_in_its_table"),
    ),
    Break(
        "a digit of a figure in a page",
        "docs/results/networks.md",
        "2.1e-7 (1.7e-7 to 2.3e-7)",
        "2.1e-7 (1.6e-7 to 2.3e-7)",
        tests(
            "tests/docs/test_kept_figures.py::test_every_figure_of_a_page_is_the_one_in_the_file"
        ),
    ),
    Break(
        "two folders that import each other, one by importlib",
        "twin/water/density.py",
        "from __future__ import annotations\n",
        "from __future__ import annotations\n\nimport importlib\n\n"
        '\ndef late():\n    return importlib.import_module("twin.physics.scenario")\n\n\n',
        tests("tests/test_architecture.py::test_nor_by_the_names_of_lazy_imports"),
    ),
    Break(
        "a wrong block in a how-to",
        "docs/howto/navigation.md",
        "navigator.state().keys()",
        "navigator.states().keys()",
        tests("tests/docs/test_blocks.py::test_navigation_runs"),
    ),
    Break(
        "a split of missions that is off by one",
        "factory/sampling/drawn_plan.py",
        "    splits[:validation] = VALIDATION\n",
        "    splits[: validation - 1] = VALIDATION\n",
        tests("tests/factory/sampling/test_plan.py::test_the_split_is_70_15_15_by_mission"),
    ),
    Break(
        "a public name without a docstring",
        "factory/sampling/drawn_plan.py",
        '    """A split for each of `count` missions, at least one of each."""\n',
        "",
        ("-m", "ruff", "check", "factory/sampling/drawn_plan.py"),
    ),
    Break(
        "a mutant whose text is gone",
        "twin/sensors/dvl.py",
        "cell_reach = its.cell_max / math.cos(tilt)",
        "cell_reach = its.cell_max * (1.0 / math.cos(tilt))",
        ("scripts/mutate.py", "--list"),
    ),
)


def noticed(one: Break) -> bool:
    """Whether the gate fails while the file is broken.

    Raises:
      ValueError: the file has the text not once, or is changed already.
    """
    path = ROOT / one.file
    text = path.read_text(encoding="utf-8")
    if text.count(one.before) != 1:
        raise ValueError(f"{one.file} has {one.before!r} {text.count(one.before)} times, not once")
    try:
        path.write_text(text.replace(one.before, one.after), encoding="utf-8")
        done = subprocess.run(
            [sys.executable, *one.gate],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    finally:
        path.write_text(text, encoding="utf-8")
    return done.returncode != 0


def table() -> str:
    """Markdown of the breaks and their gates."""
    rows = ["| break | in | gate |", "|---|---|---|"]
    for one in BREAKS:
        words = [word for word in one.gate if word not in ("-m", "-n0", "-q", "-x", "-p")]
        gate = " ".join(word for word in words if word not in ("pytest", "no:cacheprovider"))
        rows.append(f"| {one.name} | `{one.file}` | `{gate}` |")
    return "\n".join(rows)


def written(page: str) -> str:
    """The page with the table of today."""
    head, _, rest = page.partition(BEGIN)
    return f"{head}{BEGIN}\n\n{table()}\n\n{END}{rest.partition(END)[2]}"


def main(arguments: list[str] | None = None) -> int:
    """Try what was asked for; 1 when a gate stayed silent."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--only", default="", help="breaks whose name has this text")
    parser.add_argument("--write", action="store_true", help="the page's table; tries nothing")
    asked = parser.parse_args(arguments)
    if asked.write:
        PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
        return 0
    silent = 0
    for one in BREAKS:
        if asked.only in one.name:
            found = noticed(one)
            silent += not found
            print(f"{'noticed' if found else 'SILENT '}  {one.name}", flush=True)
    return int(silent > 0)


if __name__ == "__main__":
    sys.exit(main())
