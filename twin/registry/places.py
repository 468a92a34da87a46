"""Places: where a kind is written, as `module:Name`, and what stands there."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from typing import Any

from twin.registry.plugins import PLUGIN_MODULE

PROGRAMS = ("__main__", "__mp_main__")
"""Names of the file that Python was started with, here and in its worker processes."""


def imported(place: str) -> Any:
    """What stands at `module:attribute`."""
    module, _, attribute = place.partition(":")
    return getattr(importlib.import_module(module), attribute)


def place_of(kind: Any) -> str:
    """`module:Name` of a class or function; of an object, its class's."""
    found = kind if hasattr(kind, "__qualname__") else type(kind)
    return f"{found.__module__}:{found.__qualname__}"


def same_place(one: Any, other: Any) -> bool:
    """Whether two classes or functions are one that was defined twice."""
    both = hasattr(one, "__qualname__") and hasattr(other, "__qualname__")
    return both and place_of(one) == place_of(other)


def from_plugin(kind: Any) -> bool:
    """Whether a file that GLIDER_TWIN_PLUGINS names has written it."""
    return place_of(kind).startswith(PLUGIN_MODULE)


def importable(kind: Any) -> bool:
    """Whether a process that is started by this one finds a kind by its module and name."""
    module, _, name = place_of(kind).partition(":")
    if "<locals>" in name:
        return False
    if module == "__main__":
        return hasattr(sys.modules[module], "__file__")
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False
