"""One file after the other: what cannot be read is reported and left out, the rest is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from factory.importing.reading.tally import Tally
from twin.errors import InputError

Result = TypeVar("Result")

UNREADABLE = "unreadable file"
"""Subject of the report's entries of files that could not be read."""


def each_file(
    paths: Sequence[Path], read: Callable[[Path], Result], tally: Tally
) -> list[tuple[Path, Result]]:
    """What `read` makes of each file that it can read, in order.

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
    for path, reason in refused:
        tell_unreadable(path, reason, tally)
    return found


def tell_unreadable(path: Path, error: InputError, tally: Tally) -> None:
    """Report a file that is left out, and why."""
    why = str(error)
    tally.add("left out", UNREADABLE, 1, why if path.name in why else f"{path.name}: {why}")
