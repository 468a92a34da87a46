"""Every kind that lies in a seam's folder is in the seam's table, or nobody could name it."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import pytest
from examples import ROOT, script

from twin.plugins import imported

NO_KINDS = {
    "twin.water.current.base:CurrentSum": "a sum of kinds, which the sampler adds up",
    "twin.water.current.tabulated:Tabulated": "a function's table, which flies as a grid",
}
"""Classes derived from a seam's base that are no kind of their own, and why"""
SEAMS = script("architecture").seams()


def base_of(seam: Any) -> Any:
    """The class or protocol that all kinds of a seam share."""
    return imported(":".join(seam.base.rsplit(".", 1)))


def unregistered(modules: Sequence[ModuleType], base: type, table: Sequence[Any]) -> list[str]:
    """Kinds that modules define and a table lacks, as `module:Name`.

    A kind is an object of the base, or a class derived from it that nothing else in the folder
    derives from. Where the table holds functions that make kinds, one of the class's own module and
    name, in lower case, stands for it.
    """
    classes, objects = {}, {}
    for module in modules:
        for name, value in vars(module).items():
            own = isinstance(value, type) and value.__module__ == module.__name__
            if own and value is not base and issubclass(value, base):
                classes[f"{module.__name__}:{name}"] = value
            elif not isinstance(value, type) and isinstance(value, base):
                objects[f"{module.__name__}:{name}"] = value
    functions = [kind for kind in table if inspect.isfunction(kind)]
    makers = {f"{kind.__module__}:{kind.__name__}" for kind in functions}
    known = {kind if isinstance(kind, type) else type(kind) for kind in table}
    inherited = {parent for value in classes.values() for parent in value.__mro__[1:]}
    lacking = [
        place
        for place, value in classes.items()
        if value not in known | inherited and place.lower() not in makers
    ]
    return lacking + [
        place
        for place, value in objects.items()
        if not any(value is kind for kind in table) and type(value) not in _classes_of(table)
    ]


def _classes_of(table: Sequence[Any]) -> set[type]:
    return {kind for kind in table if isinstance(kind, type)}


def modules_of(folder: str) -> list[ModuleType]:
    """The modules of a seam's folder and of the folders in it."""
    files = sorted((ROOT / folder).rglob("*.py"))
    names = (".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files)
    wanted = (name.removesuffix(".__init__") for name in names if not name.endswith("__main__"))
    return [importlib.import_module(name) for name in wanted]


def test_registries_are_made_in_the_tables_of_seams_alone():
    made = {
        str(path.relative_to(ROOT))
        for package in ("twin", "factory", "learn")
        for path in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("Registry")
    }
    assert made == {"twin/seams.py", "factory/seams.py", "learn/seams.py"}


@pytest.mark.parametrize("seam", SEAMS, ids=lambda seam: seam.what)
def test_every_kind_in_a_seam_s_folder_is_in_its_table(seam):
    base = base_of(seam)
    if getattr(base, "_is_protocol", False):
        pytest.skip("its kinds are functions of other packages: no file of the folder is one")
    lacking = unregistered(modules_of(seam.folder), base, seam.kinds)
    assert [place for place in lacking if place not in NO_KINDS] == []


@pytest.mark.parametrize("seam", SEAMS, ids=lambda seam: seam.what)
def test_a_kind_that_is_taken_out_of_a_table_is_missed(seam):
    """A table without its last kind: that kind is the one that is named."""
    base = base_of(seam)
    if getattr(base, "_is_protocol", False):
        pytest.skip("as above")
    *others, last = seam.kinds
    lacking = unregistered(modules_of(seam.folder), base, others)
    module = last.__module__ if hasattr(last, "__qualname__") else None
    found = [place for place in lacking if place not in NO_KINDS]
    assert found
    assert module is None or all(place.startswith(f"{module}:") for place in found)
