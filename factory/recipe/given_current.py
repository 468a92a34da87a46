"""Given current: one current for all missions, as `--current` describes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from twin.water.current.base import Current, current_from_dict
from twin.water.current.origin import Origin
from twin.water.current.program import Floats
from twin.water.current.spec import parse_current


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenCurrent(Current):
    """A current compiled once, however many missions meet it; gridded files are read once."""

    program: Floats
    """Compiled for the longest mission"""
    description: Mapping[str, Any]
    """What `current_from_dict` rebuilds it from, everything pinned"""

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Not needed: `compile` has the program."""
        raise NotImplementedError("a given current is compiled already")

    def compile(self, duration_s: float, origin: Origin | None = None) -> Floats:
        """The program, the same for every mission."""
        return self.program

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """As the current itself."""
        return current_from_dict(self.description).begins(duration_s, origin)

    def describe(self) -> dict[str, Any]:
        """The description."""
        return dict(self.description)


def given_current(text: str, longest_s: float) -> GivenCurrent:
    """From a `--current` text, for missions of at most `longest_s` [s]; raises CurrentError."""
    return _compiled(parse_current(text).pinned(longest_s), longest_s)


def stored_current(description: Mapping[str, Any], longest_s: float) -> GivenCurrent:
    """From a store's description; raises CurrentError when a file has changed."""
    return _compiled(current_from_dict(description), longest_s)


def _compiled(current: Current, longest_s: float) -> GivenCurrent:
    return GivenCurrent(program=current.compile(longest_s), description=current.describe())
