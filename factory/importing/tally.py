"""Counts of what an import read, repaired, left out and found missing, and the report of them.

Names that files hold: the report says of each whether it is read, left out, empty or unread.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from twin.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Mask = NDArray[np.bool_]
    Count = int | np.integer[Any] | Mask | NDArray[np.integer[Any]]

READ, LEFT_OUT, NOT_READ, EMPTY = "read", "left out", "not read", "missing"
"""What became of a name in a file: used; known and not used; unknown; known, without a value."""


class OtherKind(InputError):
    """A file without logs of this kind; a folder is read without it, and that is not an error."""


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


@dataclasses.dataclass(frozen=True)
class Doubt:
    """A stretch of a log that holds what no ocean or no vehicle allows."""

    subject: str
    """The channel or variable."""
    why: str
    """Reason, in words without a time or a place that differs from dive to dive."""
    deployment: str = ""
    """Deployment that it concerns; empty: all that are read together."""
    start: float = -math.inf
    """[s] unix."""
    end: float = math.inf
    """[s] unix."""


class Tally:
    """Collects entries; equal ones are added up, in the order in which they first appeared."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str, str], int] = {}
        self.doubts: list[Doubt] = []
        """Stretches whose rows become suspect."""
        self.names: dict[str, dict[str, str]] = {}
        """What became of each name in the files, by kind of file (`unread_names`)."""
        self.unreadable: list[tuple[str, str]] = []
        """Files that could not be read, by name, and why."""

    def add(self, action: str, subject: str, count: Count = 1, detail: str = "") -> None:
        """Count something, the true values of a mask or the sum of counts; a 0 is not recorded."""
        number = count if isinstance(count, int) else int(count.sum())
        if number:
            key = (action, subject, detail)
            self._counts[key] = self._counts.get(key, 0) + number

    def removed(self, values: Array, bad: Mask, subject: str, why: str) -> Array:
        """The values, NaN where they are bad, which is counted."""
        import numpy as np  # the list of kinds needs this file for its errors alone

        self.add("removed", subject, bad, why)
        return np.where(bad, np.nan, values)

    def doubt(
        self,
        subject: str,
        why: str,
        count: Count = 1,
        *,
        deployment: str = "",
        start: float = -math.inf,
        end: float = math.inf,
    ) -> None:
        """Mark a stretch of a log as suspect: the rows in it say so, and the store is not sound.

        Args: as of `Doubt`; count: samples or files that it concerns.
        """
        self.add("suspect", subject, count, why)
        self.doubts.append(Doubt(subject, why, deployment, start, end))

    def take(self, other: Tally) -> None:
        """Become what another one is, such as a copy that counted on."""
        self.__dict__.update(other.__dict__)

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
    suspect: int
    """Rows that hold what no ocean or vehicle allows; the store says why."""
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


def summarise(names: Sequence[str], limit: int = 6) -> str:
    """The names in one line, cut after `limit`."""
    head = ", ".join(map(one_line, names[:limit]))
    return head if len(names) <= limit else f"{head} and {len(names) - limit} more"


def one_line(text: str) -> str:
    """A text with its line breaks and other characters that nobody sees as Python writes them."""
    return "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)


def by_reason(refused: Sequence[tuple[str, str]], total: int) -> list[str]:
    """Names of files, of so many in all, and what follows them in words: each reason once."""
    groups: dict[str, list[str]] = {}
    for name, reason in refused:
        groups.setdefault(reason, []).append(name)
    said = []
    for reason, names in groups.items():
        words = reason.lstrip(": ")
        if len(names) > 1:
            said.append(f"{len(names)} of {total} files: {words} ({summarise(names, _FEW)})")
        else:
            said.append(one_line(names[0]) + (reason if words != reason else f": {words}"))
    return said


_FEW = 2
"""Files with the same reason that a line names."""
_NAMED = 12
"""Names that one line shows; the report's `names` holds all of them."""
_ALIKE = 0.6
"""Similarity (difflib) from which a name may stand for another."""
_MEANT = frozenset(
    f"measured_{word}"
    for word in ("pitch", "roll", "heading", "pump", "shift", "depth", "pressure")
)
"""Channels that a name which holds their last word may mean"""


def note_unread(kind: str, present: Iterable[str], read: Iterable[str], tally: Tally) -> None:
    """Remember every name that is there, and which of them the reader looks for.

    Args:
      kind: what the report calls the file, such as "flight table".
      present: every name in a file of that kind.
      read: the names that the reader looks for. One that it finds and does not use is told by
        `leave_out` or `note_empty`.
    """
    known = set(read)
    states = tally.names.setdefault(kind, {})
    for name in present:
        states.setdefault(name, READ if name in known else NOT_READ)


def leave_out(
    names: Iterable[str], why: str, tally: Tally, *, samples: int = 1, together: str = ""
) -> None:
    """Names that the reader knows and does not use, because of another one in the same file.

    One line each, or one of them `together` under that subject.
    """
    names = list(names)
    for name in names:
        for states in tally.names.values():
            if name in states:
                states[name] = LEFT_OUT
        if not together:
            tally.add("left out", name, samples, why)
    if together:
        tally.add("left out", together, len(names), f"{summarise(names, _NAMED)}: {why}")


def note_empty(kind: str, names: Iterable[str], tally: Tally) -> None:
    """Names that the reader looks for and that hold no value in a file of that kind.

    A name that has values in another file of the kind is read: call this when all are read.
    """
    states = tally.names.get(kind, {})
    for name in names:
        if states.get(name) == READ:
            states[name] = EMPTY


def tell_unread(tally: Tally) -> None:
    """One counted line for each kind of file and each of: not read, without a value."""
    for kind, states in tally.names.items():
        for state, action in ((NOT_READ, "not read"), (EMPTY, "missing")):
            names = sorted(name for name, is_ in states.items() if is_ == state)
            why = summarise(names, _NAMED)
            if state == EMPTY and names:
                why = f"named in the file, without a value: {why}"
            tally.add(action, kind, len(names), why)


def unread(tally: Tally) -> dict[str, list[str]]:
    """The names that are not read, by kind of file."""
    return {
        kind: [name for name, state in states.items() if state == NOT_READ]
        for kind, states in tally.names.items()
    }


def likely_replacements(
    lacking: Sequence[str], unread: Mapping[str, Sequence[str]]
) -> dict[str, str]:
    """Of each missing channel, the unread name that may be it: `pitch` for `measured_pitch`."""
    names = [name for several in unread.values() for name in several]
    found: dict[str, str] = {}
    for channel in [one for one in lacking if one in _MEANT]:
        word = channel.removeprefix("measured_")
        holding = sorted((n for n in names if word in n.lower()), key=len)
        near = difflib.get_close_matches(word, [n.lower() for n in names], n=1, cutoff=_ALIKE)
        choices = holding or [n for n in names if [n.lower()] == near]
        if choices:
            found[channel] = choices[0]
    return found
