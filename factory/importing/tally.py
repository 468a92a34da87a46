"""Tally: counts of samples and files read, repaired, left out or missing, for the import report.

The report also lists each name in the files as read, left out, empty or unread.
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
"""A name in a file is READ (used), LEFT_OUT (unused), NOT_READ (unknown) or EMPTY (no value)."""


class OtherKind(InputError):
    """Error for a file that is no log of this kind; a folder is read without the file."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """Entry of the import report: one finding about one subject."""

    action: str
    """Action: read, kept, removed, repaired, interpolated, left out, missing, note ..."""
    subject: str
    """Channel, table or file that the finding concerns."""
    count: int
    """Number of samples, rows, fixes or files."""
    detail: str = ""
    """Reason, in words."""


@dataclasses.dataclass(frozen=True)
class Doubt:
    """Stretch of a log with values that no ocean or no vehicle allows."""

    subject: str
    """Channel or variable."""
    why: str
    """Reason in words, without a time or position that would differ from dive to dive."""
    deployment: str = ""
    """Deployment that the doubt concerns; empty: all deployments read together."""
    start: float = -math.inf
    """[s] Unix time of the first sample."""
    end: float = math.inf
    """[s] Unix time of the last sample."""


class Tally:
    """Collection of report entries; equal entries are summed, in order of first appearance."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str, str], int] = {}
        self.doubts: list[Doubt] = []
        """Stretches whose rows become suspect."""
        self.names: dict[str, dict[str, str]] = {}
        """State of each name in the files, by kind of file (see `note_unread`)."""
        self.unreadable: list[tuple[str, str]] = []
        """Names of files that could not be read, each with the reason."""

    def add(self, action: str, subject: str, count: Count = 1, detail: str = "") -> None:
        """Add a count: a number, the true values of a mask, or a sum; 0 is not recorded."""
        number = count if isinstance(count, int) else int(count.sum())
        if number:
            key = (action, subject, detail)
            self._counts[key] = self._counts.get(key, 0) + number

    def removed(self, values: Array, bad: Mask, subject: str, why: str) -> Array:
        """Return the values, with NaN where `bad` is true; count these samples as removed."""
        import numpy as np  # deferred: most users need only this module's errors

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
        """Mark a stretch of a log as suspect; the rows in it are marked, and the store is not
        sound.

        Args: see `Doubt`; count: samples or files that the doubt concerns.
        """
        self.add("suspect", subject, count, why)
        self.doubts.append(Doubt(subject, why, deployment, start, end))

    def take(self, other: Tally) -> None:
        """Replace this tally's state with another's, such as that of a copy with further counts."""
        self.__dict__.update(other.__dict__)

    def named(self) -> dict[str, dict[str, tuple[str, ...]]]:
        """Every name in the files, by kind of file and by state."""
        return {
            kind: {
                state: found
                for state in (READ, LEFT_OUT, NOT_READ, EMPTY)
                if (found := tuple(sorted(n for n, is_ in states.items() if is_ == state)))
            }
            for kind, states in self.names.items()
        }

    def entries(self) -> tuple[Entry, ...]:
        """Entries counted so far."""
        return tuple(
            Entry(action, subject, count, detail)
            for (action, subject, detail), count in self._counts.items()
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportReport:
    """Report of an import: files, rows, channels, and the entries counted."""

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
    """Rows with values that no ocean or vehicle allows; the store gives the reasons."""
    samples: int
    """Samples of all rows on the time grid."""
    hours: float
    """[h] Duration of all rows together."""
    period: float
    """[s] Sampling interval of the store."""
    channels: tuple[str, ...]
    """Schema variables that the store holds."""
    entries: tuple[Entry, ...]
    names: Mapping[str, Mapping[str, tuple[str, ...]]] = dataclasses.field(default_factory=dict)
    """Every name in the files, by kind of file and state: read, left out, not read, missing."""

    def count(self, action: str, subject: str | None = None) -> int:
        """Sum the counts of an action, for one subject or for all."""
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
    """Join names in one line; beyond `limit` only the number of further names is given."""
    head = ", ".join(map(one_line, names[:limit]))
    return head if len(names) <= limit else f"{head} and {len(names) - limit} more"


def one_line(text: str) -> str:
    """Escape line breaks and other unprintable characters as Python writes them."""
    return "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)


def by_reason(refused: Sequence[tuple[str, str]], total: int) -> list[str]:
    """Lines of text from (file name, reason) pairs of `total` files: one line for each reason."""
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
"""Largest number of files that a line names for one reason."""
_NAMED = 12
"""Largest number of names in a line; the report's `names` holds all."""
_ALIKE = 0.6
"""Smallest similarity (difflib) of an unread name that may stand for a missing channel."""
_MEANT = frozenset(
    f"measured_{word}"
    for word in ("pitch", "roll", "heading", "pump", "shift", "depth", "pressure")
)
"""Channels that an unread name may mean if the name contains the channel's last word."""


def note_unread(kind: str, present: Iterable[str], read: Iterable[str], tally: Tally) -> None:
    """Record every name in a file, and whether the reader looks for it.

    Args:
      kind: what the report calls the file, such as "flight table".
      present: every name in a file of that kind.
      read: names that the reader looks for.
    """
    known = set(read)
    states = tally.names.setdefault(kind, {})
    for name in present:
        states.setdefault(name, READ if name in known else NOT_READ)


def leave_out(
    names: Iterable[str], why: str, tally: Tally, *, samples: int = 1, together: str = ""
) -> None:
    """Record names that the reader knows and does not use because of another name in the file.

    Each name gets a line, or all share one line with the subject `together`.
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
    """Record names that the reader looks for and that have no value in files of that kind.

    Call this after all files of the kind are read: a name with values in any of them is read.
    """
    states = tally.names.get(kind, {})
    for name in names:
        if states.get(name) == READ:
            states[name] = EMPTY


def tell_unread(tally: Tally) -> None:
    """Report the names of each kind of file that are not read, and those without a value."""
    for kind, states in tally.names.items():
        for state, action in ((NOT_READ, "not read"), (EMPTY, "missing")):
            names = sorted(name for name, is_ in states.items() if is_ == state)
            why = summarise(names, _NAMED)
            if state == EMPTY and names:
                why = f"named in the file, without a value: {why}"
            tally.add(action, kind, len(names), why)


def unread(tally: Tally) -> dict[str, list[str]]:
    """Names that are not read, by kind of file."""
    return {
        kind: [name for name, state in states.items() if state == NOT_READ]
        for kind, states in tally.names.items()
    }


def likely_replacements(
    lacking: Sequence[str], unread: Mapping[str, Sequence[str]]
) -> dict[str, str]:
    """Map each missing channel to an unread name that may hold it: `measured_pitch` to `pitch`."""
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
