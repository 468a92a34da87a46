"""Parsing of command-line words into the dataclass of a subcommand, with errors of one line.

Error messages use the dataclass's options and their docstrings. `completion` returns tyro's script
by which a shell completes the words of a program.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import inspect
import io
import re
import shutil
import sys
import textwrap
import types
import typing
from collections.abc import Iterable, Iterator, Sequence
from pathlib import PurePath
from typing import Annotated, Any, NoReturn, TypeVar, Union

import tyro
from tyro import _docstrings as docstrings
from tyro import _errors as parse_errors

from twin.cli.console import Runnable
from twin.cli.options import METAVAR, apart
from twin.errors import InputError, TwinError, nearest, unknown_name
from twin.records.storage.store_path import MARK, check_addresses

# tyro's structured parse errors and texts of fields are private. So pyproject.toml bounds its
# version, and tests/twin/cli/test_console.py pins the messages that are made from them.

MARKERS = (tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone)
"""One flag per switch (no `--no-json`), and no literal None: an option is left out instead."""

Options = TypeVar("Options", bound=Runnable)
NO_DEFAULT = tyro.conf.arg(help_behavior_hint="")
WIDEST = 100  # columns of a paragraph in a help text at most
KINDS = {int: "a whole number", float: "a number"}  # words for the numbers that options take
SHELLS = ("bash", "zsh", "fish")


def parse_options(command: type[Options], *, prog: str, words: Sequence[str]) -> Options | None:
    """Make an instance of `command` from the words after its name; None when help was printed.

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
    said, about = _HelpText(sys.stdout), description(command)
    kept = contextlib.redirect_stdout(said) if asked else contextlib.nullcontext()
    try:
        with parse_errors.on_parse_error(reject), kept:
            given = tyro.cli(command, prog=prog, description=about, args=words, config=MARKERS)
        for value in vars(given).values():
            check_addresses(value)
        return given
    except SystemExit as leaving:
        if leaving.code not in (0, None):
            raise InputError(f"these options cannot be used (see {prog} --help)") from None
        sys.stdout.write(_wrapped(said.getvalue()))
        return None


def prepare(command: type[Any], *, texts: bool) -> None:
    """Change a dataclass's annotations for tyro; with `texts`, join the lines of help texts too.

    `X | None` becomes `typing.Union[X, None]`: for `X | None` tyro loads typeguard (and with it
    asyncio), which costs 80 ms, a third of the time that a help text may take.

    "(default: None)" and a switch's "(default: False)" are left out of the help: an option's text
    says what happens without the option, and a switch that is not given is off.

    tyro 1.0 joins a docstring's lines before it removes their indentation, and so keeps every line
    break of the source. A text that is one line is wrapped to the terminal.
    """
    hints = typing.get_type_hints(command, include_extras=True)
    for owner in command.__mro__:
        own = vars(owner).get("__annotations__", {})
        for name in own.keys() & hints.keys():
            own[name] = _spelled_out(hints.pop(name))  # popped: a base's own version stays
    for field in dataclasses.fields(command):
        own = vars(option_owner(command, field.name))["__annotations__"]
        notes = getattr(own[field.name], "__metadata__", ())
        more = []
        if field.default is None or field.default is False or field.default == ():
            more.append(NO_DEFAULT)
        if texts and all(getattr(note, "help", None) is None for note in notes):
            text = option_text(command, field.name)
            more += [] if text is None else [tyro.conf.arg(help=text)]
        for note in more:
            if note not in notes:
                own[field.name] = Annotated[own[field.name], note]


class _HelpText(io.StringIO):
    """Buffer for a help text with its stream's encoding and `isatty`, which tyro adapts to."""

    def __init__(self, stream: typing.TextIO) -> None:
        super().__init__()
        self._stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._stream.encoding

    def isatty(self) -> bool:
        return self._stream.isatty()


def _wrapped(text: str) -> str:
    """Wrap a help text's paragraphs to the terminal; tyro itself wraps only the text in boxes.

    Examples are indented and stay on one line. tyro doubles the brackets of an optional list of
    arguments; here they stand once.
    """
    text = re.sub(r"\[(\[\w+ \[\w+ \.\.\.\]\])\]", r"\1", text)
    width = min(shutil.get_terminal_size().columns, WIDEST)
    wrap = functools.partial(
        textwrap.fill, width=width, break_long_words=False, break_on_hyphens=False
    )
    lines = [wrap(line) if line[:1].isalnum() else line for line in text.split("\n")]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines))


def description(command: type) -> str:
    """Description of a command from its docstring: one line for a paragraph, examples unchanged.

    tyro's own reader loses the indentation of an example that follows the first paragraph.
    """
    paragraphs = inspect.cleandoc(command.__doc__ or "").split("\n\n")
    return "\n\n".join(
        text if text.startswith("    ") else " ".join(text.split()) for text in paragraphs
    )


def _spelled_out(kind: typing.Any) -> typing.Any:
    if isinstance(kind, types.UnionType):
        return typing.Union[kind.__args__]  # noqa: UP007
    if typing.get_origin(kind) is Annotated:
        inner, *notes = typing.get_args(kind)
        return Annotated[(_spelled_out(inner), *notes)]
    return kind


def _own_error(error: BaseException | None) -> TwinError | None:
    """Find the project's own error that caused tyro's, for its better message; None without one."""
    while error is not None and not isinstance(error, TwinError):
        error = error.__cause__ or error.__context__
    return error


def option_names(command: type) -> Iterator[str]:
    """Option names of a dataclass; names of nested dataclasses have a prefix."""
    hints = typing.get_type_hints(command)
    for field in dataclasses.fields(command):
        kind = hints[field.name]
        flag = "--" + field.name.replace("_", "-")
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            yield from (f"{flag}.{inner[2:]}" for inner in option_names(kind))
        else:
            yield flag.rstrip("-")  # a field is called from_, since from is a keyword of Python


def option_text(command: type, name: str) -> str | None:
    """Docstring of a field on one line; None for a field without one."""
    text = docstrings.get_field_docstring(option_owner(command, name), name, ())
    return None if text is None else " ".join(text.split())


def option_owner(command: type, name: str) -> type:
    """Class that declares a field."""
    return next(c for c in command.__mro__ if name in vars(c).get("__annotations__", {}))


def option_field(command: type, flag: str) -> str | None:
    """Field that an option sets; None if no field has that name."""
    fields = {f.name.strip("_"): f.name for f in dataclasses.fields(command)}
    return fields.get(flag.strip("-").replace("-", "_").lower())


def option_meaning(command: type, flag: str) -> str:
    """First clause of an option's help text; empty for an option without text."""
    name = option_field(command, flag)
    text = (option_text(command, name) or "") if name is not None else ""
    for end in (";", ". ", ": ", " [default"):
        text = text.partition(end)[0]
    return text.rstrip(".")


def explain(event: parse_errors.ParseErrorEvent, command: type, words: Sequence[str]) -> str:
    """Message of one line for a parse error in the `words` of a command."""
    if isinstance(event, parse_errors.UnrecognizedArgs):
        return _unknown_option(event.tokens, command, words)
    if isinstance(event, parse_errors.MissingArgs):
        if any(token.startswith("-") for token in event.unrecognized_tokens):
            return _unknown_option(event.unrecognized_tokens, command, words)
        names = ", ".join(missing.arg.display_name() for missing in event.missing_arguments)
        return f"missing {names}"
    if isinstance(event, parse_errors.InvalidChoice):
        allowed = [choice for choice in event.choices if choice != "None"]  # an option left out
        near = nearest(event.value, allowed, close=0.5)
        hint = f": did you mean {near!r}?" if near else ""
        return (
            f"{event.argument.display_name()} cannot be {event.value!r}{hint} "
            f"(allowed: {', '.join(allowed)})"
        )
    if isinstance(event, parse_errors.BadValue):
        return _with_meaning(f"{event.argument.display_name()} needs a value", command)
    if isinstance(event, parse_errors.InstantiationFailure):
        return _bad_value(event, command, words)
    return f"these options cannot be used together ({type(event).__name__})"


def _bad_value(
    event: parse_errors.InstantiationFailure, command: type, words: Sequence[str]
) -> str:
    """Message for a value that cannot be converted to the option's type."""
    if event.argument is None:
        return event.message
    name = event.argument.display_name()
    field = option_field(command, name)
    kind = None if field is None else number_kind(typing.get_type_hints(command)[field])
    given = [] if kind is None else [w for w in _given(words, name) if not _is(kind, w)]
    if kind is None or not given:
        return f"{name}: {' '.join(event.message.split())}"
    return _with_meaning(f"{name} needs {KINDS[kind]}, got {given[0]!r}", command)


def number_kind(annotation: object) -> type | None:
    """Return int or float if an option takes only numbers of that type, else None."""
    parts = typing.get_args(annotation)
    if not parts:
        return annotation if annotation in KINDS else None
    kinds = {number_kind(part) for part in parts if part not in (types.NoneType, ...)}
    return kinds.pop() if len(kinds) == 1 else None


def _given(words: Sequence[str], option: str) -> list[str]:
    """Words that follow an option, up to the next option."""
    given: list[str] = []
    mine = False
    for word in words:
        flag, equals, value = word.partition("=")
        if flag.startswith("--"):
            mine = flag.replace("_", "-") == option
            given += [value] * (mine and bool(equals))
        elif mine:
            given.append(word)
    return given


def _is(kind: type, word: str) -> bool:
    try:
        kind(word)
    except ValueError:
        return False
    return True


def _with_meaning(told: str, command: type) -> str:
    """Append the option's meaning to a message that begins with the option, to show its unit."""
    meaning = option_meaning(command, told.split()[0])
    return f"{told}: {meaning}" if meaning else told


def split_duration(command: type, words: Sequence[str]) -> str | None:
    """Message for a duration that is two words, such as --hours 6 weeks; None if there is none.

    Without this check the second word would be taken for a positional argument, such as a store.
    """
    hints = typing.get_type_hints(command, include_extras=True)
    parts = [word for given in words for word in given.split("=", 1)]
    for flag, number, word in zip(parts, parts[1:], parts[2:], strict=False):
        field = option_field(command, flag) if flag.startswith("--") else None
        if field is not None and METAVAR in repr(hints[field]) and (told := apart(number, word)):
            return f"{flag}: {told}"
    return None


def _unknown_option(tokens: Sequence[str], command: type, words: Sequence[str]) -> str:
    offender = next((token for token in tokens if token.startswith("-")), tokens[0])
    known = sorted(option_names(command))
    if not offender.startswith("-"):  # a word that belongs to no option
        place = words.index(offender) if offender in words else 0
        before = words[place - 1] if place else ""
        if typing.get_type_hints(command).get(before.strip("-").replace("-", "_")) is bool:
            return f"{before} takes no value: leave {offender!r} out"
        return f"unexpected argument {offender!r}"
    given = offender.partition("=")[0]
    if given in known:
        return f"{given} is not an option: give its value alone, without the name"
    near = nearest(given, known)
    if near is None:
        return f"unknown option {offender}: allowed: {', '.join(known)}"
    meaning = option_meaning(command, near)
    return f"unknown option {offender}: did you mean {near}{f' ({meaning})' if meaning else ''}?"


def completion(
    program: str, summary: str, commands: Iterable[tuple[str, str, type[Any]]], shell: str
) -> str:
    """Make the script that a shell sources to complete commands, options, choices and files.

    Args:
      program: name of the program; summary: its purpose.
      commands: name, summary and dataclass of each command.
      shell: one of `SHELLS`.

    Raises:
      InputError: unknown shell.
    """
    if shell not in SHELLS:
        raise InputError(unknown_name("shell", shell, SHELLS))
    known: list[Any] = []
    for name, told, options in commands:
        prepare(options, texts=True)
        known.append(Annotated[options, tyro.conf.subcommand(name, description=told)])
    words, script = ["--tyro-print-completion", shell], io.StringIO()
    with contextlib.redirect_stdout(script), contextlib.suppress(SystemExit):
        kind: Any = Union[tuple(known)]  # noqa: UP007 - of a tuple
        tyro.cli(kind, prog=program, description=summary, args=words, config=MARKERS)
    # complete every other word, such as a store, as the name of a file
    return script.getvalue().replace("complete -F", "complete -o default -F")
