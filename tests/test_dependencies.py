"""Dependencies: what is imported is declared, and dm-control's are ours where it goes in alone."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from twin.control.dm_suite import ALONE, MUJOCO_BELOW

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OWN = ("twin", "factory", "learn")
PYTHON_313 = {"python_version": "3.13", "extra": ""}


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def declared() -> list[Requirement]:
    """Every requirement of users: the tests' and the linters' do not count."""
    extras = PROJECT["optional-dependencies"]
    users = [r for name, extra in extras.items() if name not in ("test", "lint") for r in extra]
    return [Requirement(text) for text in [*PROJECT["dependencies"], *users]]


def imported() -> set[str]:
    """Top modules that the three packages import from elsewhere."""
    found = set()
    for path in (path for name in OWN for path in (ROOT / name).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found - set(OWN) - sys.stdlib_module_names


def test_every_import_is_declared() -> None:
    names = {plain(requirement.name) for requirement in declared()}
    distributions = metadata.packages_distributions()
    for module in sorted(imported()):
        sources = {plain(name) for name in distributions.get(module, [module])}
        assert sources & names, f"{module} comes from {sources}, which pyproject.toml does not name"


def test_all_brings_every_extra_of_a_user() -> None:
    extras = PROJECT["optional-dependencies"]
    (everything,), (dev,) = (map(Requirement, extras[name]) for name in ("all", "dev"))
    # boto3 and the pinned dateutil exclude each other; the others are for who works on the project
    assert everything.extras == set(extras) - {"all", "dev", "docs", "test", "lint", "aws"}
    assert dev.extras == {"all", "docs", "test", "lint"}


def test_python_3_13_has_all_that_dm_control_needs_but_labmaze() -> None:
    needed = [Requirement(text) for text in metadata.requires("dm-control") or ()]
    wanted = {plain(r.name) for r in needed if not r.marker or r.marker.evaluate(PYTHON_313)}
    named = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["suite"]]
    ours = [Requirement(text) for text in named]
    there = {plain(r.name) for r in ours if not r.marker or r.marker.evaluate(PYTHON_313)}
    assert wanted - there == {"labmaze"}
    assert "dm-control" not in there


def test_the_suite_names_the_range_of_dm_control() -> None:
    suite = PROJECT["optional-dependencies"]["suite"]
    (range_,) = [Requirement(text) for text in suite if text.startswith("dm-control")]
    asked = Requirement(ALONE.split('"')[1])
    assert (asked.name, asked.specifier) == (range_.name, range_.specifier)


def test_the_suite_carries_the_mujoco_that_its_code_accepts() -> None:
    """The tasks of dm_control alone need an older one: everything else takes the newer too."""
    (ours,) = [Requirement(r) for r in PROJECT["dependencies"] if r.startswith("mujoco")]
    suite = PROJECT["optional-dependencies"]["suite"]
    (theirs,) = [Requirement(r) for r in suite if r.startswith("mujoco")]
    newer = f"{MUJOCO_BELOW}.0.0"
    assert newer in ours.specifier
    assert newer not in theirs.specifier
    least = {spec.version for spec in ours.specifier if spec.operator == ">="}
    assert least == {spec.version for spec in theirs.specifier if spec.operator == ">="}
    assert all(version in theirs.specifier for version in least)
