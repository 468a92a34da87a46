"""Columns and variables that files hold and the import does not read, named in the report."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence

from factory.importing.reading.tally import Tally, summarise

_NAMED = 12
"""Names that one line shows."""
_ALIKE = 0.6
"""Similarity (difflib) from which a name may stand for another."""
_WORDS = {
    "measured_pitch": "pitch", "measured_roll": "roll", "measured_heading": "heading",
    "measured_pump": "pump", "measured_shift": "shift", "measured_depth": "depth",
    "measured_pressure": "pressure",
}  # fmt: skip
"""What a name holds that may mean the channel."""


def note_unread(kind: str, present: Iterable[str], read: Iterable[str], tally: Tally) -> None:
    """Remember the names that are there and not read.

    Args:
      kind: what the line calls the file, such as "flight table".
      present: every name in a file of that kind.
      read: the names that the reader looks for.
    """
    known = set(read)
    names = tally.unread.setdefault(kind, [])
    names.extend(n for n in dict.fromkeys(present) if n not in known and n not in names)


def tell_unread(tally: Tally) -> None:
    """One counted line for each kind of file."""
    for kind, names in tally.unread.items():
        tally.add("not read", kind, len(names), summarise(sorted(names), _NAMED))


def likely_replacements(
    lacking: Sequence[str], unread: Mapping[str, Sequence[str]]
) -> dict[str, str]:
    """Of each missing channel, the unread name that may be it: `pitch` for `measured_pitch`."""
    names = [name for several in unread.values() for name in several]
    found: dict[str, str] = {}
    for channel in lacking:
        word = _WORDS.get(channel)
        if word is None:
            continue
        holding = [n for n in names if word in n.lower()]
        near = difflib.get_close_matches(word, [n.lower() for n in names], n=1, cutoff=_ALIKE)
        choice = min(holding, key=len) if holding else next(
            (n for n in names if near and n.lower() == near[0]), None
        )  # fmt: skip
        if choice is not None:
            found[channel] = choice
    return found
