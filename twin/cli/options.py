"""Options of a subcommand: command-line words into its dataclass, with errors of one line."""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import inspect
import io
import re
import shutil
import sys
import textwrap
import types
import typing
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NoReturn, TypeVar

import tyro

# The structured parse errors and the texts of fields are not in tyro's public face, and
# pyproject.toml bounds its version for that reason; tests/twin/cli/test_console.py pins what is
# made from them.
from tyro import _docstrings as docstrings
from tyro import _errors as parse_errors

from twin.errors import InputError, TwinError

if TYPE_CHECKING:
    from twin.cli.runnable import Runnable

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
        raise InputError(f"{_explain(event, command)} (see {prog} --help)")

    _spell_unions_out(command)
    _hide_plain_defaults(command)
    asked = not {"-h", "--help"}.isdisjoint(words)
    if asked:
        _join_lines(command)
    said = _HelpText(sys.stdout)
    kept = contextlib.redirect_stdout(said) if asked else contextlib.nullcontext()
    try:
        with parse_errors.on_parse_error(reject), kept:
            about = description(command)
            return tyro.cli(command, prog=prog, description=about, args=list(words), config=MARKERS)
    except SystemExit as leaving:
        if leaving.code not in (0, None):
            raise InputError(f"these options cannot be used (see {prog} --help)") from None
        sys.stdout.write(_wrapped(said.getvalue()))
        return None


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

    Examples are indented and stay on one line.
    """
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


def option_names(command: type) -> Iterator[str]:
    """The option names of a dataclass, those of nested dataclasses with their prefix."""
    hints = typing.get_type_hints(command)
    for field in dataclasses.fields(command):
        kind = hints[field.name]
        flag = "--" + field.name.replace("_", "-")
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            yield from (f"{flag}.{inner[2:]}" for inner in option_names(kind))
        else:
            yield flag


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
        owner = _owner(command, field.name)
        notes = getattr(vars(owner)["__annotations__"][field.name], "__metadata__", ())
        if any(getattr(note, "help", None) is not None for note in notes):
            continue
        text = docstrings.get_field_docstring(owner, field.name, ())
        if text is not None:
            _annotate(command, field.name, tyro.conf.arg(help=" ".join(text.split())))


def _annotate(command: type, name: str, note: typing.Any) -> None:
    """Add a note for tyro to a field, once."""
    own = vars(_owner(command, name))["__annotations__"]
    if note not in getattr(own[name], "__metadata__", ()):
        own[name] = typing.Annotated[own[name], note]


def _owner(command: type, name: str) -> type:
    """The class that declares a field."""
    return next(c for c in command.__mro__ if name in vars(c).get("__annotations__", {}))


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


def _explain(event: parse_errors.ParseErrorEvent, command: type) -> str:
    if isinstance(event, parse_errors.UnrecognizedArgs):
        return _unknown_option(event.tokens, command)
    if isinstance(event, parse_errors.MissingArgs):
        if any(token.startswith("-") for token in event.unrecognized_tokens):
            return _unknown_option(event.unrecognized_tokens, command)
        names = ", ".join(missing.arg.display_name() for missing in event.missing_arguments)
        return f"missing {names}"
    if isinstance(event, parse_errors.InvalidChoice):
        allowed = [choice for choice in event.choices if choice != "None"]  # an option left out
        near = difflib.get_close_matches(event.value, allowed, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}? " if near else ""
        return (
            f"{event.argument.display_name()} cannot be {event.value!r}: "
            f"{hint}(allowed: {', '.join(allowed)})"
        )
    if isinstance(event, parse_errors.BadValue):
        return f"{event.argument.display_name()} needs a value"
    if isinstance(event, parse_errors.InstantiationFailure):
        place = f"{event.argument.display_name()}: " if event.argument is not None else ""
        return f"{place}{event.message}"
    return f"these options cannot be used together ({type(event).__name__})"


def _unknown_option(tokens: Sequence[str], command: type) -> str:
    offender = next((token for token in tokens if token.startswith("-")), tokens[0])
    if not offender.startswith("-"):
        return f"unexpected argument {offender!r}"
    known = sorted(option_names(command))
    given = offender.partition("=")[0]
    if given in known:
        return f"{given} is no option: give its value alone, without the name"
    near = difflib.get_close_matches(given, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}?" if near else f"allowed: {', '.join(known)}"
    return f"unknown option {offender}: {hint}"
