"""Lazy import of a package's public names when they are first used (PEP 562).

A package's `__init__` stays cheap, and a record can offer `plot()` without importing figures.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from twin.errors import unknown_name

_WRAPPED = re.compile(r"import \(\s*(\w+ as \w+),?\s*\)")
"""Pattern of an import of one name that was wrapped because it was too long for a line"""


def resolve(place: str) -> Any:
    """Import the object at `package.module:name`, or the module if `place` has no name."""
    module, _, name = place.partition(":")
    found = importlib.import_module(module)
    return getattr(found, name) if name else found


def places(package: str) -> dict[str, str]:
    """Places of a package's public names, as `package.module:name` or `package.module`.

    They are read from the lines `from MODULE import NAME as PUBLIC_NAME` in the package's own
    `if TYPE_CHECKING`, as type checkers read them.
    """
    found = {}
    text = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
    text = _WRAPPED.sub(r"import \1", text)
    for line in text.splitlines():
        match line.split():
            case ["from", module, "import", name, "as", public, *_] if line.startswith(" "):
                found[public] = f"{module}{'.' if module == package else ':'}{name}"
    return found


def attach(
    package: str, places: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__getattr__` and `__dir__` for a package's module from its public names' `places`."""

    def get(name: str) -> Any:
        if name not in places:
            message = f"module {package!r} has no attribute {name!r}"
            if not name.startswith("_"):  # Python itself asks for names such as __path__
                message = f"module {package!r}: {unknown_name('name', name, places)}"
            raise AttributeError(message, name=name, obj=sys.modules[package])
        value = resolve(places[name])
        setattr(sys.modules[package], name, value)
        return value

    return get, lambda: sorted(places)
