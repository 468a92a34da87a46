"""Lazy: public names of a package that are imported when they are first used (PEP 562).

A package's face stays cheap to import, and a record can offer `plot()` without importing figures.
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
"""An import of one name that is too long for a line"""


def resolve(place: str) -> Any:
    """The object at `package.module:name`, or the module of a place without a name."""
    module, _, name = place.partition(":")
    found = importlib.import_module(module)
    return getattr(found, name) if name else found


def places(package: str) -> dict[str, str]:
    """`package.module:name`, or `package.module`, by public name of a package.

    They are read where type checkers read them: in the package's own `if TYPE_CHECKING`, from its
    lines `from MODULE import NAME as PUBLIC_NAME`.
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
    """`__getattr__` and `__dir__` of a package, whose `__name__` it is, with its `places`."""

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
