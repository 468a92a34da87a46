"""Mistakes: what is wrong with the words of a command line, said in one line.

It reads the options of a subcommand's dataclass by name, and what their docstrings say.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Iterator, Sequence

from tyro import _docstrings as docstrings
from tyro import _errors as parse_errors

from twin.cli.durations import METAVAR, apart
from twin.errors import nearest

# Not in tyro's public face: see twin.cli.options.


def option_names(command: type) -> Iterator[str]:
    """The option names of a dataclass, those of nested dataclasses with their prefix."""
    hints = typing.get_type_hints(command)
    for field in dataclasses.fields(command):
        kind = hints[field.name]
        flag = "--" + field.name.replace("_", "-")
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            yield from (f"{flag}.{inner[2:]}" for inner in option_names(kind))
        else:
            yield flag.rstrip("-")  # from_, since from is a word of Python


def option_text(command: type, name: str) -> str | None:
    """What a field's docstring says, on one line; None for a field without one."""
    text = docstrings.get_field_docstring(option_owner(command, name), name, ())
    return None if text is None else " ".join(text.split())


def option_owner(command: type, name: str) -> type:
    """The class that declares a field."""
    return next(c for c in command.__mro__ if name in vars(c).get("__annotations__", {}))


def option_field(command: type, flag: str) -> str | None:
    """The field that an option sets; None where there is none of that name."""
    fields = {f.name.strip("_"): f.name for f in dataclasses.fields(command)}
    return fields.get(flag.strip("-").replace("-", "_").lower())


def option_meaning(command: type, flag: str) -> str:
    """The first clause of an option's text, such as its unit; empty where there is none."""
    name = option_field(command, flag)
    text = (option_text(command, name) or "") if name is not None else ""
    for end in (";", ". ", ": ", " [default"):
        text = text.partition(end)[0]
    return text.rstrip(".")


# The structured parse errors are not in tyro's public face: see twin.cli.options.


KINDS = {int: "a whole number", float: "a number"}
"""What options of a kind need"""


def explain(event: parse_errors.ParseErrorEvent, command: type, words: Sequence[str]) -> str:
    """What an event of the parser means for the options of `command`, given as `words`."""
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
    """A value that cannot be made one of the option's kind."""
    if event.argument is None:
        return event.message
    name = event.argument.display_name()
    field = option_field(command, name)
    kind = None if field is None else number_kind(typing.get_type_hints(command)[field])
    given = [word for word in _given(words, name) if kind is None or not _is(kind, word)]
    if kind is None or not given:
        return f"{name}: {' '.join(event.message.split())}"
    return _with_meaning(f"{name} needs {KINDS[kind]}, got {given[0]!r}", command)


def number_kind(annotation: object) -> type | None:
    """int or float where an option takes numbers of that kind only; None else."""
    parts = typing.get_args(annotation)
    if not parts:
        return annotation if annotation in KINDS else None
    kinds = {number_kind(part) for part in parts if part not in (types.NoneType, ...)}
    return kinds.pop() if len(kinds) == 1 else None


def _given(words: Sequence[str], option: str) -> list[str]:
    """The words that follow an option, up to the next one."""
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
    """The line with the option's meaning behind it, so that its unit is seen."""
    meaning = option_meaning(command, told.split()[0])
    return f"{told}: {meaning}" if meaning else told


def split_duration(command: type, words: Sequence[str]) -> str | None:
    """What is wrong with a duration that is two words, such as --hours 6 weeks; None without one.

    Otherwise the second word would be taken for a mission, a store or whatever stands alone.
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
    if not offender.startswith("-"):
        return _unexpected(offender, command, words)
    given = offender.partition("=")[0]
    if given in known:
        return f"{given} is not an option: give its value alone, without the name"
    near = nearest(given, known)
    if near is None:
        return f"unknown option {offender}: allowed: {', '.join(known)}"
    meaning = option_meaning(command, near)
    return f"unknown option {offender}: did you mean {near}{f' ({meaning})' if meaning else ''}?"


def _unexpected(offender: str, command: type, words: Sequence[str]) -> str:
    """A word that belongs to no option."""
    hints = typing.get_type_hints(command)
    place = words.index(offender) if offender in words else 0
    before = words[place - 1] if place else ""
    if hints.get(before.strip("-").replace("-", "_")) is bool:
        return f"{before} takes no value: leave {offender!r} out"
    return f"unexpected argument {offender!r}"
