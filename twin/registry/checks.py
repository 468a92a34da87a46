"""Checks: what a seam asks of a kind before it takes it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from twin.errors import InputError, TwinError
from twin.registry.places import place_of

Kind = TypeVar("Kind")


def instance_of(noun: str, base: type[Kind]) -> Callable[[str, Any], Kind]:
    """The check of a seam whose kinds are objects that bear their name in `name`.

    Args:
      noun: what a kind is called in errors.
      base: the class that it must be an object of.
    """

    def check(name: str, kind: Any) -> Kind:
        if not isinstance(kind, base):
            raise InputError(
                f"{kind!r} cannot be registered as a{'n' if noun[0] in 'aeiou' else ''} {noun}: "
                f"it must be a {base.__module__}.{base.__name__}"
            )
        own = getattr(kind, "name", None)
        if own != name:
            raise InputError(f"{noun} {name!r} leads to {kind!r}, which has another name")
        return kind

    return check


def self_named(
    noun: str, base: type[Kind], lacks: Callable[[Any], str], error: type[TwinError]
) -> Callable[[str, Any], type[Kind]]:
    """The check of a seam whose kinds are classes that bear their name in `kind`.

    Args:
      noun: what a kind is called in errors.
      base: the class that it must derive from.
      lacks: what a class that is only half there lacks; empty when nothing.
      error: class of the errors.
    """

    def check(name: str, kind: Any) -> type[Kind]:
        if not (isinstance(kind, type) and issubclass(kind, base)):
            raise error(
                f"{kind!r} cannot be registered as a {noun}: derive it from "
                f"{base.__module__}.{base.__name__}"
            )
        own = getattr(kind, "kind", "")
        if own != name:
            raise error(f"{noun} {name!r}: the class {kind.__name__} calls itself {own!r}")
        missing = lacks(kind)
        if missing:
            raise error(f"the {noun} {name!r} is only half there: it lacks {missing}")
        return kind

    return check


def missing_method(kind: type) -> str:
    """The first method that a class leaves abstract, as `lacks` says it; "" where none is."""
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    return f"the method `{missing[0]}`" if missing else ""


def check_class(noun: str, name: str, kind: Any, base: type, words: tuple[str, ...]) -> None:
    """What a seam whose kinds are classes asks of each.

    Args:
      base: the class that it must derive from, with nothing left abstract.
      words: attributes that must hold a text that is not empty.

    Raises:
      InputError: it is only half there, or its name is not an identifier.
    """
    if not name.isidentifier():
        raise InputError(f"a {noun} needs a name of letters, digits and underscores, not {name!r}")
    if not (isinstance(kind, type) and issubclass(kind, base)):
        raise InputError(
            f"{noun} {name!r} must be a class derived from {base.__module__}.{base.__name__}"
        )
    if missing := sorted(getattr(kind, "__abstractmethods__", ())):
        raise InputError(f"{noun} {name!r} ({place_of(kind)}) lacks {', '.join(missing)}()")
    for word in words:
        text = getattr(kind, word, None)
        if not (isinstance(text, str) and text.strip()):
            raise InputError(
                f"{noun} {name!r} ({place_of(kind)}) lacks {word}, a text of one line for tables "
                "and messages"
            )
