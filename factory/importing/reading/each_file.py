"""One file after the other: what cannot be read is reported and left out, the rest is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from factory.importing.reading.other_kind import OtherKind
from factory.importing.reading.tally import Tally, summarise
from twin.errors import InputError

Result = TypeVar("Result")

UNREADABLE = "unreadable file"
"""Subject of the report's entries of files that could not be read."""
OTHER_KIND = "file of another kind"
"""Subject of those that are no logs of the kind, as offload folders hold them: no failure."""
_NAMED = 2
"""Files that an entry of several names"""


def each_file(
    paths: Sequence[Path], read: Callable[[Path], Result], tally: Tally
) -> list[tuple[Path, Result]]:
    """What `read` makes of each file that it can read, in order.

    Files with the same reason are reported together.

    Raises:
      InputError: of the first file, when none can be read.
    """
    found: list[tuple[Path, Result]] = []
    refused: list[tuple[Path, InputError]] = []
    for path in paths:
        try:
            found.append((path, read(path)))
        except InputError as error:
            refused.append((path, error))
    if refused and not found:
        raise refused[0][1]
    _tell(refused, len(paths), tally)
    return found


def _tell(refused: Sequence[tuple[Path, InputError]], total: int, tally: Tally) -> None:
    """Report the files that are left out, by reason."""
    groups: dict[tuple[str, str], list[tuple[Path, InputError]]] = {}
    for path, error in refused:
        subject = OTHER_KIND if isinstance(error, OtherKind) else UNREADABLE
        groups.setdefault((subject, _reason(path, error)), []).append((path, error))
    for (subject, reason), members in groups.items():
        if len(members) == 1:
            path, error = members[0]
            why = str(error)
            why = why if path.name in why else f"{path.name}: {why}"
        else:
            names = summarise([path.name for path, _ in members], _NAMED)
            why = f"{len(members)} of {total} files: {reason} ({names})"
        tally.add("left out", subject, len(members), why)


def _reason(path: Path, error: InputError) -> str:
    """What an error says, without the name of the file that it begins with."""
    why = str(error)
    for name in (str(path), path.name):
        why = why.removeprefix(name)
    return why.lstrip(": ")
