"""Names that files hold: the report says of each whether it is read, left out, empty or unread."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence

from factory.importing.reading.tally import EMPTY, LEFT_OUT, NOT_READ, READ, Tally, summarise

_NAMED = 12
"""Names that one line shows; the report's `names` holds all of them."""
_ALIKE = 0.6
"""Similarity (difflib) from which a name may stand for another."""
_WORDS = {
    "measured_pitch": "pitch", "measured_roll": "roll", "measured_heading": "heading",
    "measured_pump": "pump", "measured_shift": "shift", "measured_depth": "depth",
    "measured_pressure": "pressure",
}  # fmt: skip
"""What a name holds that may mean the channel."""


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
