"""Console: output of a command, as text for people or exactly one JSON object, and its progress.

Standard output carries the answer, standard error everything else (progress, notes, warnings,
errors). With `--json` the answer is one JSON object and the human text is left out.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import PurePath
from typing import IO, TYPE_CHECKING, Any, Protocol, Self

from twin.cli import text_table
from twin.cli.text_table import format_number, format_paragraph, printable

if TYPE_CHECKING:
    from tqdm import tqdm

LINE_INTERVAL_S = 30.0  # [s] between progress lines when standard error is a file or a pipe


@dataclass(frozen=True, kw_only=True)
class JsonOption:
    """Base of the commands that print numbers: adds `--json`."""

    json: bool = False
    """Print one JSON object on standard output and nothing else there."""


class Console:
    """Output of one command.

    `prog` is the program's name in front of warnings and errors. With `json` the answer is one JSON
    object: `answer` collects its members, and `finish` prints it when the command ends.
    """

    def __init__(self, prog: str, *, json: bool = False) -> None:
        self.prog = prog
        self.json = json
        self._out: IO[str] = sys.stdout
        self._answer: dict[str, Any] | None = None

    def say(self, text: str = "") -> None:
        """Print one paragraph of the answer for people; nothing with `--json`."""
        if not self.json:
            self._write(text + "\n")

    def table(
        self, rows: Sequence[Mapping[str, object]], *, title: str = "", digits: int = 4
    ) -> None:
        """Print the rows as a table with one column per key; nothing with `--json`."""
        heading = "\n".join(map(format_paragraph, title.split("\n"))) + "\n" if title else ""
        self.say(heading + text_table.format_table(rows, digits=digits))

    def item(self, text: str) -> None:
        """Print one item of a list of sentences, wrapped; nothing with `--json`."""
        self.say(format_paragraph(f"- {text}", indent="  "))

    def pairs(self, pairs: Mapping[str, object], *, title: str = "", digits: int = 4) -> None:
        """Print name and value on each line, aligned; nothing with `--json`."""
        self.say((f"{title}\n" if title else "") + text_table.format_pairs(pairs, digits=digits))

    def answer(self, **figures: object) -> None:
        """Add members to the JSON object; without `--json` they are not printed.

        NumPy scalars and arrays, paths and dataclasses are converted; NaN and infinities become
        null, since JSON has no word for them.
        """
        self._answer = {**(self._answer or {}), **{k: to_json(v) for k, v in figures.items()}}

    def note(self, text: str) -> None:
        """Print a line on standard error that is not part of the answer."""
        self._flush()  # a terminal shows both streams: keep the order of the lines
        try:
            sys.stderr.write(printable(text) + "\n")
            sys.stderr.flush()
        except OSError:  # no stream is left to report on; the exit code still tells
            discard(sys.stderr)

    def warn(self, text: str) -> None:
        """Print a warning on standard error, one line."""
        self.note(f"{self.prog}: warning: {one_line(text)}")

    def error(self, text: str) -> None:
        """Print an error on standard error, one line."""
        self.note(f"{self.prog}: error: {one_line(text)}")

    def progress(self, *, total: float, label: str, unit: str) -> Progress:
        """Make a context manager that shows progress on standard error: see `Progress`."""
        return Progress(total=total, label=label, unit=unit)

    def finish(self, error: Mapping[str, object] | None = None) -> None:
        """Print the JSON object with `--json`, and flush.

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
        """Discard all later output; raise the error once unless the reader closed the pipe."""
        discard(self._out)
        if not isinstance(error, BrokenPipeError):
            raise error


class Runnable(Protocol):
    """Instance of a subcommand's dataclass."""

    def run(self, console: Console) -> int:
        """Do the work and return the exit code."""
        ...


def discard(stream: IO[str]) -> None:
    """Redirect a stream to the null device.

    `twin ... | head` closes the pipe early. The command must still finish its work, and the
    interpreter's own flush at exit must not fail.
    """
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def one_line(text: str) -> str:
    """Replace every run of white space, including line breaks, by one blank."""
    return " ".join(text.split())


def to_json(value: object) -> Any:
    """Convert a value for JSON: NaN and infinities to None, rounding noise and -0.0 to 0.0.

    Raises:
        TypeError: the value's type has no JSON form here.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        if abs(value) < text_table.NEGLIGIBLE:
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
    # NumPy scalars and arrays are recognised by their method, so that NumPy is not imported here.
    tolist = getattr(value, "tolist", None)
    if callable(tolist):
        return to_json(tolist())
    raise TypeError(f"no JSON form for {type(value).__name__} {value!r}")


class Progress:
    """Progress on standard error; a context manager.

    A terminal shows a bar that is redrawn. A log file or a pipe gets one line every `interval_s`
    seconds; a task that ends before the first line prints nothing.

        with console.progress(total=10.0, label="generate", unit="h") as progress:
            progress.update(0.75, missions=1)
    """

    def __init__(
        self,
        *,
        total: float,
        label: str,
        unit: str,
        stream: IO[str] | None = None,
        interval_s: float = LINE_INTERVAL_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start at zero; `total` is in `unit`. With an empty `unit` only the percentage is shown.
        `clock` returns seconds; tests replace it.
        """
        self.total, self.label, self.unit, self.done = total, label, unit, 0.0
        self._stream = sys.stderr if stream is None else stream
        self._interval_s = interval_s
        self._clock = clock
        self._figures: dict[str, str] = {}
        self._start = self._last_line = clock()
        self._printed = False
        self._bar: tqdm | None = None

    def __enter__(self) -> Self:
        self._start = self._last_line = self._clock()
        if self._stream.isatty():
            from tqdm import tqdm

            form, left = "{desc}: {percentage:3.0f}% |{bar}| ", "{remaining} left{postfix}"
            done = "{n:.4g}/{total:.4g} {unit} [{rate_fmt}, "
            self._bar = tqdm(
                total=self.total, desc=self.label, unit=self.unit, file=self._stream,
                dynamic_ncols=True, bar_format=form + (f"{done}{left}]" if self.unit else left),
            )  # fmt: skip
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if self._bar is not None:
            self._bar.close()
        elif self._printed and not isinstance(error, KeyboardInterrupt):
            self._print_line()

    def update(self, amount: float = 1.0, **figures: object) -> None:
        """Advance by `amount`; `figures` (a loss, a count) are shown beside the progress."""
        self.done += amount
        self._figures.update({name: format_number(value, 3) for name, value in figures.items()})
        if self._bar is not None:
            if figures:
                self._bar.set_postfix(self._figures, refresh=False)
            self._bar.update(amount)
        elif self._clock() - self._last_line >= self._interval_s:
            self._print_line()

    def note(self, text: str) -> None:
        """Print a line without breaking the bar."""
        if self._bar is not None:
            self._bar.write(text, file=self._stream)
        else:
            self._write(text)

    def line(self) -> str:
        """Text of the present state, one line."""
        elapsed = self._clock() - self._start
        share = f"{100.0 * self.done / self.total:.0f} %" if self.total > 0.0 else ""
        done = f"{format_number(self.done, 3)} of {format_number(self.total, 3)} {self.unit}"
        parts = [(done + (f" ({share})" if share else "")) if self.unit else share]
        if elapsed > 0.0 and self.done > 0.0:
            rate = self.done / elapsed
            if self.unit:
                parts.append(f"{format_number(rate, 3)} {self.unit}/s")
            parts.append(f"{format_duration(max(self.total - self.done, 0.0) / rate)} left")
        parts += [f"{name} {text}" for name, text in self._figures.items()]
        return f"{self.label}: {', '.join(parts)}"

    def _print_line(self) -> None:
        self._last_line = self._clock()
        self._printed = True
        self._write(self.line())

    def _write(self, text: str) -> None:
        self._stream.write(text + "\n")
        self._stream.flush()


def format_duration(seconds: float) -> str:
    """Format seconds as hours, minutes and seconds, e.g. `1:02:05` or `0:07`."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"
