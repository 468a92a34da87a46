"""Lazy: public names of a package that are imported when they are first used (PEP 562).

A package's face stays cheap to import, and a record can offer `plot()` without importing figures.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any

from twin.errors import unknown_name


def resolve(place: str) -> Any:
    """The object at `package.module:name`, or the module of a place without a name."""
    module, _, name = place.partition(":")
    found = importlib.import_module(module)
    return getattr(found, name) if name else found


def attach(
    package: str, places: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package whose public names are at `places`.

    Args:
      package: its `__name__`.
      places: `package.module:name` or `package.module` by public name.
    """

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
