"""Option texts: the options of a subcommand's dataclass by name, and what it says about them."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Iterator

# Not in tyro's public face: see twin.cli.options.
from tyro import _docstrings as docstrings


def option_names(command: type) -> Iterator[str]:
    """The option names of a dataclass, those of nested dataclasses with their prefix."""
    hints = typing.get_type_hints(command)
    for field in dataclasses.fields(command):
        kind = hints[field.name]
        flag = "--" + field.name.replace("_", "-")
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            yield from (f"{flag}.{inner[2:]}" for inner in option_names(kind))
        else:
            yield flag.rstrip("-")  # from_, since from is a word of Python


def option_text(command: type, name: str) -> str | None:
    """What a field's docstring says, on one line; None for a field without one."""
    text = docstrings.get_field_docstring(option_owner(command, name), name, ())
    return None if text is None else " ".join(text.split())


def option_owner(command: type, name: str) -> type:
    """The class that declares a field."""
    return next(c for c in command.__mro__ if name in vars(c).get("__annotations__", {}))


def option_field(command: type, flag: str) -> str | None:
    """The field that an option sets; None where there is none of that name."""
    fields = {f.name.strip("_"): f.name for f in dataclasses.fields(command)}
    return fields.get(flag.strip("-").replace("-", "_").lower())


def option_meaning(command: type, flag: str) -> str:
    """The first clause of an option's text, such as its unit; empty where there is none."""
    name = option_field(command, flag)
    text = (option_text(command, name) or "") if name is not None else ""
    for end in (";", ". ", ": ", " [default"):
        text = text.partition(end)[0]
    return text.rstrip(".")
