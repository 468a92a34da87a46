"""Text: the pieces of one current's settings on the command line, `NAME=VALUE` between commas."""

from __future__ import annotations

import math
from collections.abc import Iterable

from twin.errors import CurrentError


def split_settings(kind: str, rest: str) -> tuple[list[str], dict[str, str]]:
    """Split comma-separated values into positional ones and NAME=VALUE."""
    positional: list[str] = []
    given: dict[str, str] = {}
    for item in rest.split(","):
        name, equals, value = item.partition("=")
        name, value = name.strip(), value.strip()
        if not equals:
            positional.append(name)
            continue
        name = name.lower()
        if name in given:
            raise CurrentError(f"{kind}: {name}= is given twice")
        given[name] = value
    return positional, given


def number(kind: str, name: str, text: str) -> float:
    """A finite number; raises CurrentError."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CurrentError(f"{kind}: {name} must be a number, not {text!r}")
    return value


def whole_number(kind: str, name: str, text: str) -> int:
    """A whole number; raises CurrentError."""
    value = number(kind, name, text)
    if value != int(value):
        raise CurrentError(f"{kind}: {name} must be a whole number, not {value:g}")
    return int(value)


def allowed(names: Iterable[str]) -> str:
    """The end of a message: which settings there are."""
    return f"settings: {', '.join(names)}"
