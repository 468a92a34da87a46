"""Counts of what an import read, repaired, left out and found missing, and the report of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

READ, LEFT_OUT, NOT_READ, EMPTY = "read", "left out", "not read", "missing"
"""What became of a name in a file: used; known and not used; unknown; known, without a value."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """One kind of finding about one thing."""

    action: str
    """What was done: read, kept, removed, repaired, interpolated, left out, missing, note ..."""
    subject: str
    """The channel, table or file."""
    count: int
    """How many samples, rows, fixes or files it concerns."""
    detail: str = ""
    """Why, in words."""


class Tally:
    """Collects entries; equal ones are added up, in the order in which they first appeared."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str, str], int] = {}
        self.names: dict[str, dict[str, str]] = {}
        """What became of each name in the files, by kind of file (`unread_names`)."""

    def add(self, action: str, subject: str, count: int = 1, detail: str = "") -> None:
        """Count something; nothing is recorded for a count of 0."""
        if count:
            key = (action, subject, detail)
            self._counts[key] = self._counts.get(key, 0) + int(count)

    def named(self) -> dict[str, dict[str, tuple[str, ...]]]:
        """Every name in the files by kind of file and by what became of it."""
        return {
            kind: {
                state: found
                for state in (READ, LEFT_OUT, NOT_READ, EMPTY)
                if (found := tuple(sorted(n for n, is_ in states.items() if is_ == state)))
            }
            for kind, states in self.names.items()
        }

    def entries(self) -> tuple[Entry, ...]:
        """Everything counted so far."""
        return tuple(
            Entry(action, subject, count, detail)
            for (action, subject, detail), count in self._counts.items()
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportReport:
    """What an import read, made and repaired."""

    kind: str
    """Name of the importer, such as slocum."""
    files: tuple[str, ...]
    """Names of the files that were read, without folders."""
    deployments: tuple[str, ...]
    rows: int
    """Dives or GPS-to-GPS segments in the store."""
    rows_with_fixes: int
    """Rows that begin and end with a GPS fix."""
    samples: int
    """Samples of all rows on the grid."""
    hours: float
    """[h] of all rows together."""
    period: float
    """[s] between the samples of the store."""
    channels: tuple[str, ...]
    """Schema variables that the store holds."""
    entries: tuple[Entry, ...]
    names: Mapping[str, Mapping[str, tuple[str, ...]]] = dataclasses.field(default_factory=dict)
    """Every name in the files: by kind of file, those read, left out, not read and missing."""

    def count(self, action: str, subject: str | None = None) -> int:
        """Sum over the entries of an action, of one subject or of all."""
        return sum(
            e.count
            for e in self.entries
            if e.action == action and (subject is None or e.subject == subject)
        )

    def table(self) -> list[dict[str, object]]:
        """Rows for a terminal: action, subject, count, detail."""
        return [
            {"what": e.action, "of": e.subject, "count": e.count, "why": e.detail}
            for e in self.entries
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return dataclasses.asdict(self)


def finite(values: np.ndarray) -> int:
    """How many values are finite."""
    return int(np.isfinite(values).sum())


def summarise(names: Sequence[str], limit: int = 6) -> str:
    """The names in one line, cut after `limit`."""
    head = ", ".join(names[:limit])
    return head if len(names) <= limit else f"{head} and {len(names) - limit} more"
