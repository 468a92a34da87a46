"""What a command says: text for people, or exactly one JSON object for programs.

Standard output carries the answer, standard error everything else (progress, notes, warnings,
errors). With `--json` the answer is one JSON object and the human text is left out.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import PurePath
from typing import IO, TYPE_CHECKING, Any

from twin.cli.text_table import NEGLIGIBLE, format_pairs, format_paragraph, format_table, printable

if TYPE_CHECKING:
    from twin.cli.progress import Progress


@dataclass(frozen=True, kw_only=True)
class JsonOption:
    """Base of the commands that print figures: adds `--json`."""

    json: bool = False
    """Print one JSON object on standard output and nothing else there."""


class Console:
    """Output of one command.

    `prog` is the program's name in front of notes and errors. `json` tells whether the answer is
    the JSON object; `answer` then collects it, and the dispatcher prints it when the command ends.
    """

    def __init__(self, prog: str, *, json: bool = False) -> None:
        self.prog = prog
        self.json = json
        self._out: IO[str] = sys.stdout
        self._answer: dict[str, Any] | None = None

    def say(self, text: str = "") -> None:
        """One paragraph of the answer for people; left out with `--json`."""
        if not self.json:
            self._write(text + "\n")

    def table(
        self, rows: Sequence[Mapping[str, object]], *, title: str = "", digits: int = 4
    ) -> None:
        """The rows as a table with one column per key; left out with `--json`."""
        heading = "\n".join(map(format_paragraph, title.split("\n"))) + "\n" if title else ""
        self.say(heading + format_table(rows, digits=digits))

    def item(self, text: str) -> None:
        """One item of a list of sentences, wrapped; left out with `--json`."""
        self.say(format_paragraph(f"- {text}", indent="  "))

    def pairs(self, pairs: Mapping[str, object], *, title: str = "", digits: int = 4) -> None:
        """Name and value on each line, aligned; left out with `--json`."""
        self.say((f"{title}\n" if title else "") + format_pairs(pairs, digits=digits))

    def answer(self, **figures: object) -> None:
        """Add members to the JSON object; without `--json` they are not printed.

        NumPy scalars and arrays, paths and dataclasses are converted; NaN and infinities become
        null, since JSON has no word for them.
        """
        self._answer = {**(self._answer or {}), **{k: to_json(v) for k, v in figures.items()}}

    def note(self, text: str) -> None:
        """A line on standard error that is not part of the answer."""
        self._error(text)

    def warn(self, text: str) -> None:
        """A warning on standard error, one line."""
        self._error(f"{self.prog}: warning: {one_line(text)}")

    def error(self, text: str) -> None:
        """An error on standard error, one line."""
        self._error(f"{self.prog}: error: {one_line(text)}")

    def progress(self, *, total: float, label: str, unit: str) -> Progress:
        """Progress on standard error, a context manager: see `twin.cli.progress.Progress`."""
        from twin.cli.progress import Progress

        return Progress(total=total, label=label, unit=unit)

    def finish(self, error: Mapping[str, object] | None = None) -> None:
        """Print the JSON object if there is to be one, and flush.

        Raises:
            RuntimeError: the command offers `--json` and ended well without an answer.
        """
        if self.json:
            if self._answer is None and error is None:
                raise RuntimeError("the command ended without an answer for --json")
            members = {**(self._answer or {}), **(error or {})}
            self._write(json.dumps(members, allow_nan=False) + "\n")
        self._flush()

    def _write(self, text: str) -> None:
        try:
            self._out.write(printable(text))
        except OSError as error:
            self._give_up(error)

    def _flush(self) -> None:
        try:
            self._out.flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        """After this, what is said goes nowhere: a full disk is told once, as an error."""
        discard(self._out)
        if not isinstance(error, BrokenPipeError):
            raise error

    def _error(self, text: str) -> None:
        self._flush()  # a terminal shows both streams: keep the order in which things were said
        try:
            sys.stderr.write(printable(text) + "\n")
            sys.stderr.flush()
        except OSError:  # nowhere is left to say it; the exit code still does
            discard(sys.stderr)


def discard(stream: IO[str]) -> None:
    """Let what is still said go nowhere.

    `twin ... | head` closes the pipe early. The work itself must still come to its end, and the
    interpreter's own flush at exit must not fail.
    """
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def one_line(text: str) -> str:
    """The text with every run of white space, line breaks too, as one blank."""
    return " ".join(text.split())


def to_json(value: object) -> Any:
    """The value as JSON can hold it; NaN and infinities as None, rounding noise and -0.0 as 0.0.

    Raises:
        TypeError: the value is of a kind that has no JSON form here.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        if abs(value) < NEGLIGIBLE:
            return 0.0
        return value if abs(value) <= sys.float_info.max else None
    if isinstance(value, Mapping):
        return {str(key): to_json(member) for key, member in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [to_json(member) for member in value]
    if isinstance(value, PurePath):
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        return to_json(asdict(value))
    # NumPy scalars and arrays, recognised by what they can do so that NumPy is not imported here.
    tolist = getattr(value, "tolist", None)
    if callable(tolist):
        return to_json(tolist())
    raise TypeError(f"no JSON form for {type(value).__name__} {value!r}")
