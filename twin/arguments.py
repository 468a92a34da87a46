"""Arguments: calls that do not fit a public function, told with what it takes.

Python's own TypeError for `twin.simulate(durations=5)` does not name the argument that was meant,
and the one for `factory.generate(hours="10 h")` comes from deep inside. A package's face
(`twin.lazy.attach`) puts `explained` around every public function and into every public class;
their signatures stay as they are written.
"""

from __future__ import annotations

import functools
import inspect
import numbers
import os
import pathlib
import sys
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from twin.errors import ArgumentError, TwinError, shown, unknown_name

BY_NAME = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
BY_PLACE = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
FROM_INSIDE = (TypeError, ValueError, AttributeError)
"""Errors of Python's own that a value of a wrong kind ends in"""


def _listed(value: Any) -> bool:
    """Whether a value is a list, an array or alike; a text is not, though Python thinks so."""
    return isinstance(value, Iterable) and not isinstance(
        value, str | bytes | Mapping | os.PathLike
    )


Takes = tuple[Callable[[Any], bool], str]
KINDS: dict[Any, Takes] = {
    float: (lambda value: isinstance(value, numbers.Real), "a number"),
    int: (lambda value: isinstance(value, numbers.Integral), "a whole number"),
    bool: (lambda value: isinstance(value, bool), "True or False"),
    str: (lambda value: isinstance(value, str), "a text"),
    pathlib.Path: (lambda value: isinstance(value, str | os.PathLike), "a path"),
    Mapping: (lambda value: isinstance(value, Mapping), "a mapping"),
    Sequence: (_listed, "a list"),
    Iterable: (_listed, "a list"),
    list: (_listed, "a list"),
    tuple: (_listed, "a list"),
    Callable: (callable, "a function"),
}
"""Whether a value is what an annotation takes, and how that is called"""


def explained(value: Any, name: str, package: str) -> Any:
    """A public function or class whose misfitting calls raise `ArgumentError`.

    A class is changed in place, so that it stays the same for `isinstance`. A function is wrapped;
    another process finds it under its public name. Anything else comes back as it is.

    Args:
      value: what the package's face offers.
      name: under which it does.
      package: its `__name__`.
    """
    where = f"{package}.{name}"
    if inspect.isfunction(value):
        wrapped = _explained(value, where)
        wrapped.__module__, wrapped.__qualname__ = package, name
        return wrapped
    made = vars(value).get("__init__") if inspect.isclass(value) else None
    if inspect.isfunction(made) and not hasattr(made, "explained"):
        value.__init__ = _explained(made, where)
    return value


def argument_names(*functions: Callable[..., Any]) -> list[str]:
    """Names of what functions take by name."""
    signatures = [inspect.signature(function) for function in functions]
    return list({n: p for s in signatures for n, p in s.parameters.items() if p.kind in BY_NAME})


def check_names(given: Iterable[str], allowed: Iterable[str], where: str) -> None:
    """Refuse the first argument name that is not among `allowed`.

    Raises:
      ArgumentError: with the nearest name.
    """
    known = list(allowed)
    for name in given:
        if name not in known:
            raise ArgumentError(f"{where}: {unknown_name('argument', name, known)}")


def _explained(function: Callable[..., Any], where: str) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*given: Any, **named: Any) -> Any:
        try:
            return function(*given, **named)
        except FROM_INSIDE as error:
            ours = isinstance(error, TwinError)
            if ours and function.__name__ == "__init__":
                raise  # classes check their fields themselves
            try:
                _check_call(function, given, named, where, letters=ours)
            except ArgumentError as misfit:
                raise misfit from error
            raise

    call.explained = True  # type: ignore[attr-defined]
    return call


def _check_call(
    function: Callable[..., Any],
    given: Sequence[Any],
    named: Mapping[str, Any],
    where: str,
    *,
    letters: bool,
) -> None:
    """Raise ArgumentError when a call does not fit a function or a value not its annotation.

    With `letters` only for a text in place of a list, whose letters an error of ours is about.
    """
    signature = inspect.signature(function)
    try:
        bound = signature.bind(*given, **named)
    except TypeError as error:
        _check_fit(function, given, named, where)
        raise ArgumentError(f"{where}: {error}") from None
    for name, value in bound.arguments.items():
        parameter = signature.parameters[name]
        if parameter.kind not in (*BY_NAME, *BY_PLACE) or (letters and not isinstance(value, str)):
            continue
        wanted = list(_kinds(_evaluated(parameter.annotation, function)))
        if letters and not any(takes is _listed for takes, _ in wanted):
            continue
        _check_kind(value, wanted, f"{where}: {name}")


def _check_fit(
    function: Callable[..., Any], given: Sequence[Any], named: Mapping[str, Any], where: str
) -> None:
    """Raise ArgumentError for arguments that are unknown, too many or missing."""
    signature = inspect.signature(function)
    parameters = {n: p for n, p in signature.parameters.items() if n != "self"}
    places = [n for n, p in parameters.items() if p.kind in BY_PLACE]
    names = [n for n in argument_names(function) if n in parameters]
    kinds = {p.kind for p in parameters.values()}
    if inspect.Parameter.VAR_KEYWORD not in kinds:
        check_names(named, names, where)
    count = len(given) - ("self" in signature.parameters)
    if count > len(places) and inspect.Parameter.VAR_POSITIONAL not in kinds:
        first = f"only {', '.join(places)} without a name" if places else "nothing without a name"
        others = ", ".join(f"{name}=..." for name in names if name not in places)
        raise ArgumentError(f"{where} takes {first}; by name: {others or 'nothing'}")
    needed = [
        name
        for name, parameter in parameters.items()
        if parameter.default is parameter.empty
        and parameter.kind in (*BY_NAME, *BY_PLACE)
        and name not in named
        and name not in places[:count]
    ]
    if needed:
        raise ArgumentError(f"{where} needs {', '.join(needed)}")


def _check_kind(value: Any, wanted: Sequence[Takes], what: str) -> None:
    """Raise ArgumentError when a value is of none of the kinds."""
    if not wanted or any(takes(value) for takes, _ in wanted):
        return
    words = list(dict.fromkeys(word for _, word in wanted))
    raise ArgumentError(f"{what} is {shown(value)}: give {' or '.join(words)}")


def _kinds(annotation: Any) -> Iterator[Takes]:
    """What an annotation takes, each kind with its name; nothing where one is unknown."""
    if isinstance(annotation, types.UnionType) or typing.get_origin(annotation) is typing.Union:
        found = [list(_kinds(one)) for one in typing.get_args(annotation)]
        if all(found):
            yield from (kind for kinds in found for kind in kinds)
        return
    annotation = typing.get_origin(annotation) or annotation
    if annotation in (None, types.NoneType):
        yield (lambda value: value is None), "None"
    elif annotation in KINDS:
        yield KINDS[annotation]
    elif inspect.isclass(annotation) and not _lenient(annotation):
        article = "an" if annotation.__name__[0] in "AEIOU" else "a"
        yield (lambda value: isinstance(value, annotation)), f"{article} {annotation.__name__}"


def _lenient(kind: type) -> bool:
    """Whether values of other classes do as well: array-likes, and what is told by its methods."""
    anything = kind in (Any, inspect.Parameter.empty)
    return anything or kind.__module__ == "numpy" or getattr(kind, "_is_protocol", False)


def _evaluated(annotation: Any, function: Callable[..., Any]) -> Any:
    """An annotation as an object; Any where only type checkers know its names."""
    if not isinstance(annotation, str):
        return annotation
    try:
        return eval(annotation, inspect.unwrap(function).__globals__, _Public())  # our own text
    except (NameError, TypeError):
        return Any


class _Public(dict[str, Any]):
    """Public names of `twin`, for annotations that a module imports for type checkers only."""

    def __missing__(self, name: str) -> Any:
        twin = sys.modules.get("twin")
        if twin is None or name not in twin.__all__:
            raise KeyError(name)
        return getattr(twin, name)
