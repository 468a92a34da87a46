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
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from twin.errors import InputError, unknown_name

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

PLUGINS = "GLIDER_TWIN_PLUGINS"
"""Environment variable with the Python files of a user's own kinds."""


class Named(Protocol):
    """What every kind has."""

    @property
    def name(self) -> str:
        """What the user types."""


Kind = TypeVar("Kind", bound=Named)


class Registry(Generic[Kind]):
    """Kinds in the order in which they were registered; those of other packages follow."""

    def __init__(self, what: str, base: type[Kind], *, group: str):
        """An empty registry.

        Args:
          what: what errors call one kind, such as "kind of log".
          base: the class that every kind is an instance of.
          group: the group of entry points that installed packages use.
        """
        self.what = what
        self.base = base
        self.group = group
        self._kinds: dict[str, Kind] = {}
        self._installed: dict[str, EntryPoint] | None = None

    def register(self, kind: Kind) -> Kind:
        """Add a kind, and return it.

        Raises:
          InputError: it is not of the seam's class, or the name is taken.
        """
        if not isinstance(kind, self.base):
            raise InputError(
                f"{kind!r} cannot be registered as a {self.what}: it must be a "
                f"{self.base.__module__}.{self.base.__name__}"
            )
        if kind.name in self._kinds:
            raise InputError(f"there is a {self.what} {kind.name!r} already; choose another name")
        self._kinds[kind.name] = kind
        return kind

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
          InputError: there is none, or the package that brings it fails.
        """
        names = self.names()
        if name not in names:
            raise InputError(unknown_name(self.what, name, names))
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
            raise InputError(
                f"{source} cannot be loaded from {entry.value}: {type(error).__name__}: {error}"
            ) from error
        if getattr(kind, "name", None) != entry.name:
            raise InputError(f"{source}: its entry point leads to {kind!r}, which has another name")
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
