"""Registries: the kinds of one seam by name, shipped ones and those of users.

A kind is a class. Shipped kinds are listed by the place to import them from, so that their names
are known without importing them: `--help` lists the networks and imports no torch. Others come in

- by `register`, in any module that is imported before the name is used, or
- by an entry point of an installed package, in the group of the registry.

Both are checked when they are first used: a kind that is only half there is refused by name, with
what it lacks.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any, Generic, TypeVar

from twin.errors import InputError, unknown_name

Kind = TypeVar("Kind")


class Registry(Mapping[str, type[Kind]], Generic[Kind]):
    """Classes by name; a class is imported when it is looked up.

    Args:
      seam: what a kind is called in messages, such as "network".
      group: of the entry points through which installed packages bring kinds.
      shipped: `package.module:Class` of each kind of this package, in the order of the tables.
      check: `package.module:function` that is given name and class of every kind that is not
        shipped, once, and raises `InputError` for one that is only half there.
    """

    def __init__(
        self,
        seam: str,
        group: str,
        shipped: Mapping[str, str],
        check: str,
    ) -> None:
        self.seam, self.group, self.shipped = seam, group, dict(shipped)
        self._check = check
        self._loaded: dict[str, type[Kind]] = {}
        self._registered: dict[str, type[Kind]] = {}

    def register(self, name: str) -> Callable[[type[Kind]], type[Kind]]:
        """A decorator that brings in a class under a name.

        Raises:
          InputError: the name is no plain word or belongs to another class, or the class is only
            half there.
        """
        if not name.isidentifier():
            raise InputError(
                f"a {self.seam} needs a name of letters, digits and underscores, not {name!r}"
            )

        def bring(kind: type[Kind]) -> type[Kind]:
            if name in self.shipped or name in self._entry_points():
                raise InputError(f"{self.seam} {name!r} exists already; choose another name")
            before = self._registered.get(name, kind)
            if place_of(before) != place_of(kind):
                raise InputError(
                    f"{self.seam} {name!r} is {place_of(before)} already; choose another name for "
                    f"{place_of(kind)}"
                )
            self._registered[name] = kind  # the check builds one by its name
            try:
                self.check(name, kind)
            except InputError:
                del self._registered[name]
                raise
            return kind

        return bring

    def check(self, name: str, kind: Any) -> None:
        """Make sure that a class is a whole kind.

        Raises:
          InputError: it is only half there, with what it lacks.
        """
        _imported(self._check)(name, kind)

    def __getitem__(self, name: str) -> type[Kind]:
        """The class of a name.

        Raises:
          InputError: there is no such kind, or it is only half there.
        """
        if name in self._registered:
            return self._registered[name]
        if name not in self._loaded:
            if name in self.shipped:
                self._loaded[name] = _imported(self.shipped[name])
            elif name in (points := self._entry_points()):
                self._bring(name, points[name])
            else:
                raise InputError(self.unknown(name))
        return self._loaded[name]

    def _bring(self, name: str, point: Any) -> None:
        """Load and check the kind of an entry point."""
        try:
            self._loaded[name] = point.load()
        except (ImportError, AttributeError) as error:
            raise InputError(
                f"{self.seam} {name!r} cannot be imported from {point.value} ({error}): repair or "
                "remove the package that names it"
            ) from error
        try:
            self.check(name, self._loaded[name])
        except InputError:
            del self._loaded[name]
            raise

    def __contains__(self, name: object) -> bool:
        """Whether there is a kind of this name; nothing is imported."""
        return name in (*self.shipped, *self._registered) or name in self._entry_points()

    def __iter__(self) -> Iterator[str]:
        """Names, shipped kinds first; nothing is imported."""
        return iter(dict.fromkeys([*self.shipped, *self._entry_points(), *self._registered]))

    def __len__(self) -> int:
        """How many kinds there are."""
        return len(list(iter(self)))

    def _entry_points(self) -> dict[str, Any]:
        from importlib.metadata import entry_points

        return {p.name: p for p in entry_points(group=self.group) if p.name not in self.shipped}

    def unknown(self, name: str, place: str = "") -> str:
        """One line for a name without a kind.

        Args:
          place: where a file says that the kind is, `module:Class`.
        """
        remedy = f"import {place.partition(':')[0]}, which" if place else "import the file that"
        return (
            f"{unknown_name(self.seam, name, self)}; for a kind of your own {remedy} registers it "
            f"first, or install the package that names it as an entry point {self.group}"
        )

    def place(self, name: str) -> str:
        """`module:Class` of a kind that is not shipped, empty for a shipped one."""
        return "" if name in self.shipped else place_of(self[name])

    def registered(self) -> dict[str, type[Kind]]:
        """Kinds that `register` brought in: what another process has to be told of."""
        return dict(self._registered)

    def adopt(self, kinds: Mapping[str, type[Kind]]) -> None:
        """In another process: register what `registered` gave in the first one."""
        for name, kind in kinds.items():
            if name not in self._registered:
                self.register(name)(kind)

    def check_elsewhere(self, name: str) -> None:
        """Make sure that another process can import a kind.

        Raises:
          InputError: its class is not found by its module's name, as one in a notebook.
        """
        kind = self._registered.get(name)
        if kind is None:
            return
        if "<locals>" in kind.__qualname__ or not _found(kind.__module__):
            raise InputError(
                f"{self.seam} {name!r} ({place_of(kind)}) cannot be imported by another process: "
                "put it at the top of a file in a folder on PYTHONPATH, or train with 1 worker"
            )


def place_of(kind: type) -> str:
    """`module:Class`."""
    return f"{kind.__module__}:{kind.__qualname__}"


def _found(module: str) -> bool:
    """Whether a process that is started by this one can import a module."""
    if module == "__main__":
        return hasattr(sys.modules[module], "__file__")
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def _imported(reference: str) -> Any:
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name)


def check_class(seam: str, name: str, kind: Any, base: type, words: tuple[str, ...]) -> None:
    """What every seam asks of a kind.

    Args:
      base: the class that it must derive from, with nothing left abstract.
      words: attributes that must hold a text that is not empty.

    Raises:
      InputError: it is only half there.
    """
    if not (isinstance(kind, type) and issubclass(kind, base)):
        raise InputError(
            f"{seam} {name!r} must be a class derived from {base.__module__}.{base.__name__}"
        )
    if missing := sorted(getattr(kind, "__abstractmethods__", ())):
        raise InputError(f"{seam} {name!r} ({place_of(kind)}) lacks {', '.join(missing)}()")
    for word in words:
        text = getattr(kind, word, None)
        if not (isinstance(text, str) and text.strip()):
            raise InputError(
                f"{seam} {name!r} ({place_of(kind)}) lacks {word}, a text of one line for tables "
                "and messages"
            )
