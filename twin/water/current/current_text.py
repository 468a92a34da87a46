"""Currents as one line of text, for `--current`: KIND:SETTINGS, added with +."""

from __future__ import annotations

import re
from pathlib import Path

from twin.errors import CurrentError
from twin.water.current.base import Current, CurrentSum, kind_named, still_water
from twin.water.current.sampler import kinds

HELP_COLUMN = 42
"""Where the words of `current_help` begin, when the example is not longer."""


FILE = re.compile(r"\.[A-Za-z]\w*\s*(,|$)|[/\\]")
"""What the text of a current has that names a file"""


def current_help() -> str:
    """What `--current` accepts, an example a line, from every kind registered so far."""
    lines = [("none", "still water")]
    for kind in kinds():
        lines.extend(kind.usage.items())
    return "\n".join(
        [
            *(f"{text:{HELP_COLUMN - 2}}  {words}" for text, words in lines),
            "Directions are toward, clockwise from north. Add currents with +.",
        ]
    )


def parse_current(text: str) -> Current:
    """The current that a `--current` text describes; `current_help` lists the forms.

    Speeds in m/s, angles in degrees toward. Raises CurrentError naming what is wrong.
    """
    # A + belongs to a number (1e+3), a path or a time zone unless a kind follows it.
    pieces = re.split(r"\+(?=\s*(?:[A-Za-z][\w-]*\s*:|none\b))", text.strip())
    currents = [_parse_one(piece.strip()) for piece in pieces]
    if len(currents) == 1:
        return currents[0]
    parts = [
        part
        for current in currents
        for part in (current.parts if isinstance(current, CurrentSum) else (current,))
    ]
    return CurrentSum(parts=tuple(parts))


def parse_field(text: str) -> Current:
    """The current of a forecast: as `parse_current`, and the path of a file alone is a grid."""
    if Path(text).exists():
        return parse_current(f"grid:{text}")
    if FILE.search(text) and ":" not in text:
        raise CurrentError(
            f"no file {text!r} with a forecast of the current: a file is a path, or "
            f"grid:{text},SETTINGS; `--current` of `twin simulate --help` lists other kinds"
        )
    return parse_current(text)


def check_field(text: str) -> None:
    """Refuse what `parse_field` would refuse whatever is in its files, which are not opened and
    may be missing yet; raises CurrentError."""
    if not FILE.search(text):  # names no file
        parse_current(text)
        return
    for name in re.findall(r"(?:^|\+)\s*([A-Za-z][\w-]*)\s*:", text):
        kind_named(name.lower().replace("_", "-"), "none")


def _parse_one(text: str) -> Current:
    name, colon, rest = text.partition(":")
    name = name.strip().lower().replace("_", "-")
    if name == "none":
        if rest.strip():
            raise CurrentError(f"current 'none' takes no settings, not {rest!r}")
        return still_water()
    kind = kind_named(name, "none")
    if not colon or not rest.strip():
        example = next(iter(kind.usage))
        raise CurrentError(f"current {name!r} needs settings, e.g. {example}")
    return kind.parse(rest)
