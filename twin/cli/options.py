"""Options of a subcommand: command-line words into its dataclass, with errors of one line.

Store argument: a store as the user names it, by a path or by an address.
Parts of options that several commands have: missions, a plot, numbers by name.
"""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import io
import math
import re
import shutil
import sys
import textwrap
import types
import typing
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, NoReturn, TypeVar

import tyro
from tyro import _errors as parse_errors
from tyro.constructors import PrimitiveConstructorSpec

from twin.cli.mistakes import explain, option_owner, option_text, split_duration
from twin.errors import InputError, TwinError
from twin.records.storage.store_path import MARK, StorePath, Url, check_addresses, store_path

if TYPE_CHECKING:
    from twin.cli.endings import Runnable


# The structured parse errors and the texts of fields (twin.cli.mistakes) are not in tyro's
# public face, and pyproject.toml bounds its version for that reason;
# tests/twin/cli/test_console.py pins what is made from them.


MARKERS = (tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone)
"""One flag per switch (no `--no-json`), and no literal None: an option is left out instead."""

Options = TypeVar("Options", bound="Runnable")


def parse_options(command: type[Options], *, prog: str, words: Sequence[str]) -> Options | None:
    """An instance of `command` from the words after its name; None when help was printed.

    Raises:
        TwinError: from the dataclass's own checks.
        InputError: an option is unknown, missing or has an unusable value.
    """

    def reject(event: parse_errors.ParseErrorEvent) -> NoReturn:
        cause = _own_error(sys.exc_info()[1])
        if cause is not None:
            raise cause
        check_addresses([PurePath(word) for word in words if MARK in word])
        raise InputError(f"{explain(event, command, words)} (see {prog} --help)")

    if told := split_duration(command, words):
        raise InputError(f"{told} (see {prog} --help)")
    asked = not {"-h", "--help"}.isdisjoint(words)
    prepare(command, texts=asked)
    said = _HelpText(sys.stdout)
    kept = contextlib.redirect_stdout(said) if asked else contextlib.nullcontext()
    try:
        with parse_errors.on_parse_error(reject), kept:
            about = description(command)
            given = tyro.cli(
                command, prog=prog, description=about, args=list(words), config=MARKERS
            )
        for value in vars(given).values():
            check_addresses(value)
        return given
    except SystemExit as leaving:
        if leaving.code not in (0, None):
            raise InputError(f"these options cannot be used (see {prog} --help)") from None
        sys.stdout.write(_wrapped(said.getvalue()))
        return None


def prepare(command: type[Runnable], *, texts: bool) -> None:
    """Make a dataclass readable for tyro; `texts` joins the lines of its options too."""
    _spell_unions_out(command)
    _hide_plain_defaults(command)
    if texts:
        _join_lines(command)


WIDEST = 100
"""Columns of a paragraph in a help text at most"""


class _HelpText(io.StringIO):
    """A help text on its way to a stream, whose colours and lines tyro draws as it can show."""

    def __init__(self, stream: typing.TextIO) -> None:
        super().__init__()
        self._stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Of the stream."""
        return self._stream.encoding

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream.isatty()


def _wrapped(text: str) -> str:
    """The text with its paragraphs wrapped to the terminal; tyro wraps those in boxes only.

    Examples are indented and stay on one line. tyro writes the brackets of a list of arguments that
    may be absent twice; here they stand once.
    """
    text = re.sub(r"\[(\[\w+ \[\w+ \.\.\.\]\])\]", r"\1", text)
    width = min(shutil.get_terminal_size().columns, WIDEST)
    lines = [
        textwrap.fill(line, width, break_long_words=False, break_on_hyphens=False)
        if line[:1].isalnum() and len(line) > width
        else line
        for line in text.split("\n")
    ]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines))


def description(command: type) -> str:
    """What a command does, from its docstring: a line for each paragraph, examples as they stand.

    tyro's own reading loses the indentation of an example that follows the first paragraph.
    """
    paragraphs = inspect.cleandoc(command.__doc__ or "").split("\n\n")
    return "\n\n".join(
        text if text.startswith("    ") else " ".join(text.split()) for text in paragraphs
    )


def _spell_unions_out(command: type) -> None:
    """Write `X | None` in the dataclass's annotations as `typing.Union[X, None]`.

    tyro checks the defaults of the second form by itself, but loads typeguard (and with it asyncio)
    for the first, which costs 80 ms: a third of what a help text may take.
    """
    hints = typing.get_type_hints(command, include_extras=True)
    for owner in command.__mro__:
        own = vars(owner).get("__annotations__", {})
        for name in own.keys() & hints.keys():
            own[name] = _spelled_out(hints.pop(name))  # popped: a base's own version stays


NO_DEFAULT = tyro.conf.arg(help_behavior_hint="")


def _hide_plain_defaults(command: type) -> None:
    """Leave "(default: None)" and a switch's "(default: False)" out of the help.

    An option's text says what happens without it, and a switch that is not given is off.
    """
    for field in dataclasses.fields(command):
        if field.default is None or field.default is False or field.default == ():
            _annotate(command, field.name, NO_DEFAULT)


def _join_lines(command: type) -> None:
    """Make one line of each option's text, which tyro then wraps to the terminal.

    tyro 1.0 joins the lines of a docstring before it takes their indentation away, and so keeps
    every line break of the source.
    """
    for field in dataclasses.fields(command):
        owner = option_owner(command, field.name)
        notes = getattr(vars(owner)["__annotations__"][field.name], "__metadata__", ())
        if any(getattr(note, "help", None) is not None for note in notes):
            continue
        text = option_text(command, field.name)
        if text is not None:
            _annotate(command, field.name, tyro.conf.arg(help=text))


def _annotate(command: type, name: str, note: typing.Any) -> None:
    """Add a note for tyro to a field, once."""
    own = vars(option_owner(command, name))["__annotations__"]
    if note not in getattr(own[name], "__metadata__", ()):
        own[name] = typing.Annotated[own[name], note]


def _spelled_out(kind: typing.Any) -> typing.Any:
    if isinstance(kind, types.UnionType):
        return typing.Union[kind.__args__]  # noqa: UP007
    if typing.get_origin(kind) is typing.Annotated:
        inner, *notes = typing.get_args(kind)
        return typing.Annotated[(_spelled_out(inner), *notes)]
    return kind


def _own_error(error: BaseException | None) -> TwinError | None:
    """The project's error behind tyro's, if there is one: it knows best what to say."""
    while error is not None:
        if isinstance(error, TwinError):
            return error
        error = error.__cause__ or error.__context__
    return None


StoreArgument = Annotated[
    StorePath,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="STORE",
        instance_from_str=lambda words: store_path(words[0]),
        is_instance=lambda value: isinstance(value, Path | Url),
        str_from_instance=lambda value: [str(value)],
    ),
]
"""Type of an argument: the path of a folder, or s3://BUCKET/NAME, gs://... or az://..."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineOption:
    """Base of the commands that fly missions: adds `--engine`."""

    engine: typing.Literal["mujoco", "lanes"] = "mujoco"
    """what flies: mujoco, the twin; or lanes, the Fossen model for many vehicles side by side,
    which feels no contact and runs no Python between its steps. docs/howto/lanes.md compares them
    """


def parse_rows(text: str) -> list[int] | None:
    """Mission numbers of a text such as "0-11,14"; None for "all".

    Raises:
      InputError: the text does not follow the form.
    """
    if text.strip() == "all":
        return None
    rows: list[int] = []
    try:
        for part in text.split(","):
            first, _, last = part.strip().partition("-")
            rows += range(int(first), int(last or first) + 1)
    except ValueError:
        rows = []
    if not rows:
        raise InputError(f"--missions {text!r} must be all, or numbers such as 0-11,14")
    return list(dict.fromkeys(rows))


PLOT_FORMATS = (".png", ".pdf", ".svg")


def check_plot_path(path: Path | None) -> None:
    """Refuse a plot that could not be written before anything is flown; raises InputError."""
    if path is None:
        return
    if path.suffix.lower() not in PLOT_FORMATS or path.is_dir():
        raise InputError(f"--plot {str(path)!r} must be a file ending in {', '.join(PLOT_FORMATS)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write plot {path}: {error.strerror or error}") from error


def parse_numbers(option: str, texts: Sequence[str], what: str) -> dict[str, float]:
    """Numbers by name, of texts such as "mass=70" or "rudder=0.1,elevator=0".

    Raises:
      InputError: a text is not names with finite numbers, or gives a name twice.
    """
    numbers: dict[str, float] = {}
    for text in ",".join(texts).split(",") if texts else ():
        name, _, number = (word.strip() for word in text.partition("="))
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not (name and math.isfinite(value)):
            raise InputError(f"--{option} {text!r} must be {what}")
        if name in numbers:
            raise InputError(f"--{option} gives {name} twice; once is enough")
        numbers[name] = value
    return numbers
