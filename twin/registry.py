"""Registry: the kinds of one seam by name, those of the package and those that users add.

A kind of one's own comes in by one of three ways, none of which touches the package:

- a program calls the seam's `register(kind)`;
- an installed package names it in an entry point of the seam's group;
- the environment variable `GLIDER_TWIN_PLUGINS` names Python files that call `register`, separated
  as in PATH. They are run once in each process, before the first name is looked up.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from twin.errors import InputError, TwinError, unknown_name

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

PLUGINS = "GLIDER_TWIN_PLUGINS"
"""Environment variable with the Python files of a user's own kinds."""

Kind = TypeVar("Kind")


class Registry(Generic[Kind]):
    """Kinds in the order in which they were registered; those of other packages follow.

    A kind is an object of the seam's class, or a class derived from it.
    """

    def __init__(
        self,
        what: str,
        base: type[Any],
        *,
        group: str,
        name: str = "name",
        lacks: Callable[[Kind], str] = lambda kind: "",
        error: type[TwinError] = InputError,
    ):
        """An empty registry.

        Args:
          what: what errors call one kind, such as "kind of log".
          base: the class that every kind is an object of, or derived from.
          group: the group of entry points that installed packages use.
          name: attribute that holds a kind's name.
          lacks: what a kind that is only half there lacks, as the end of "it lacks ..."; or "".
          error: class of the errors for unknown and unusable kinds.
        """
        self.what = what
        self.base = base
        self.group = group
        self.version = 0
        """Counts the changes: what was built from an older version is out of date."""
        self._name, self._lacks, self._error = name, lacks, error
        self._kinds: dict[str, Kind] = {}
        self._installed: dict[str, EntryPoint] | None = None

    def register(self, kind: Kind) -> Kind:
        """Add a kind, and return it; usable as a decorator of classes.

        Raises:
          the registry's error: it is not of the seam's class, only half there, or the name is
            taken.
        """
        derived = isinstance(kind, type) and issubclass(kind, self.base)
        if not (derived or isinstance(kind, self.base)):
            raise self._error(
                f"{kind!r} cannot be registered as a {self.what}: it must be a "
                f"{self.base.__module__}.{self.base.__name__}"
            )
        name = getattr(kind, self._name, "")
        if not name:
            raise self._error(f"{kind!r} cannot be registered as a {self.what}: it has no name")
        missing = self._lacks(kind)
        if missing:
            raise self._error(f"the {self.what} {name!r} is only half there: it lacks {missing}")
        if name in self._kinds:
            raise self._error(f"there is a {self.what} {name!r} already; choose another name")
        self._kinds[name] = kind
        self.version += 1
        return kind

    def unregister(self, name: str) -> None:
        """Take a kind out again; raises the registry's error when there is none."""
        self[name]
        del self._kinds[name]
        self.version += 1

    def code(self, name: str) -> int:
        """Number by which compiled code knows a kind, from 1: its place in the registry."""
        self[name]
        return 1 + list(self._kinds).index(name)

    def names(self) -> tuple[str, ...]:
        """Every name, without importing what installed packages bring."""
        _run_plugins()
        return tuple(dict.fromkeys((*self._kinds, *self._entry_points())))

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __len__(self) -> int:
        return len(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self.names()

    def __getitem__(self, name: str) -> Kind:
        """The kind of that name.

        Raises:
          the registry's error: there is none, or the package that brings it fails.
        """
        names = self.names()
        if name not in names:
            raise self._error(unknown_name(self.what, str(name), names))
        if name not in self._kinds:
            self._load(self._entry_points()[name])
        return self._kinds[name]

    def values(self) -> tuple[Kind, ...]:
        """Every kind. Errors as for a single one."""
        return tuple(self[name] for name in self.names())

    def _entry_points(self) -> dict[str, EntryPoint]:
        if self._installed is None:
            from importlib.metadata import entry_points

            self._installed = {entry.name: entry for entry in entry_points(group=self.group)}
        return self._installed

    def _load(self, entry: EntryPoint) -> None:
        source = (
            f"{self.what} {entry.name!r} of the package {entry.dist.name if entry.dist else '?'}"
        )
        try:
            kind = entry.load()
        except Exception as error:
            raise self._error(
                f"{source} cannot be loaded from {entry.value}: {type(error).__name__}: {error}"
            ) from error
        if getattr(kind, self._name, None) != entry.name:
            raise self._error(f"{source}: its entry point leads to {kind!r}, which has another name")
        self.register(kind)


_plugins_ran: set[str] = set()


def _run_plugins() -> None:
    """Run the files that the environment names, each once.

    Raises:
      InputError: a file is not there or fails; the message names it.
    """
    for text in os.environ.get(PLUGINS, "").split(os.pathsep):
        if not text or text in _plugins_ran:
            continue
        _plugins_ran.add(text)  # before it runs: it looks names up itself
        try:
            _run_plugin(Path(text))
        except BaseException:
            _plugins_ran.discard(text)
            raise


def _run_plugin(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{PLUGINS} names {path}, which is not a file; correct the variable")
    name = f"glider_twin_plugin_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{PLUGINS} names {path}, which is not a Python file (.py)")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except InputError as error:
        raise InputError(f"{path} ({PLUGINS}): {error}") from error
    except Exception as error:
        raise InputError(f"{path} ({PLUGINS}) fails: {type(error).__name__}: {error}") from error
