"""Registry: the kinds of one seam by name: shipped, registered by the user, or from entry points.

Nothing is imported before it is asked for: shipped kinds are known by the place to import them
from, and an installed distribution adds its own under the seam's entry-point group:

    [project.entry-points."glider_twin.sensors"]
    turbidity = "my_package.turbidity:Turbidity"

For kinds in a file of one's own that is no distribution, the environment variable
`GLIDER_TWIN_PLUGINS` names Python files that call a seam's `register`, separated as in PATH. They
are run once in each process, before a name is first looked up.
"""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import importlib.util
import os
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from twin.errors import InputError, TwinError, UnknownName

PLUGINS = "GLIDER_TWIN_PLUGINS"
"""Environment variable with the Python files of a user's own kinds."""

Kind = TypeVar("Kind")


class Registry(Mapping[str, Kind]):
    """Kinds by name, in the order in which they became known; a kind is checked when it is loaded.

    A name that is not there raises `UnknownName`, which is an `InputError` and a `KeyError`.
    """

    def __init__(
        self,
        noun: str,
        *,
        group: str,
        shipped: Mapping[str, str] | None = None,
        check: Callable[[str, Any], Kind],
        name: str = "name",
    ):
        """Make the registry of one seam.

        Args:
          noun: what a kind is called in errors.
          group: of the entry points that add kinds.
          shipped: `package.module:attribute` by name.
          check: returns the kind, or raises InputError that says what it lacks.
          name: attribute of a kind that holds its name, for `add`.
        """
        self.noun, self.group = noun, group
        self._places = dict(shipped or {})
        self._check = check
        self._name = name
        self.version = 0
        """Counts the kinds that came or went; what was built from fewer is out of date."""
        self._loaded: dict[str, Kind] = {}

    def add(self, kind: Any) -> Any:
        """`register` a kind under the name that it bears itself, and return it: a decorator."""
        name = getattr(kind, self._name, "")
        if not isinstance(name, str) or not name:
            raise InputError(
                f"{kind!r} cannot be registered as a {self.noun}: it has no {self._name}"
            )
        self.register(name, kind)
        return kind

    def register(self, name: str, kind: Any) -> None:
        """Add a kind of one's own for this process; the same one may be registered again.

        It comes before an installed distribution's of that name, which is usually the same one.

        Raises:
          InputError: the name is taken by another kind, or the kind is only half there.
        """
        if name in self._loaded or name in self._places:
            if self[name] is kind:
                return
            raise InputError(f"{self.noun} {name!r} exists already: choose another name")
        self._loaded[name] = self._check(name, kind)
        self.version += 1

    def unregister(self, name: str) -> None:
        """Forget a kind that `register` added; raises UnknownName when there is none."""
        if name in self._places or name not in self._loaded:
            own = self._loaded.keys() - self._places.keys()
            raise UnknownName(f"registered {self.noun}", name, own)
        del self._loaded[name]
        self.version += 1

    def code(self, name: str) -> int:
        """Number by which compiled code knows a kind, the same in every process."""
        self[name]
        return zlib.crc32(name.encode())

    def loaded(self) -> tuple[Kind, ...]:
        """The kinds that have been used or registered so far."""
        return tuple(self._loaded.values())

    def shipped(self) -> tuple[str, ...]:
        """Names of the kinds that come with the package."""
        return tuple(self._places)

    def names(self) -> tuple[str, ...]:
        """Every name, without importing what installed distributions bring."""
        return tuple(self)

    def __getitem__(self, name: str) -> Kind:
        run_plugins()
        if name not in self._loaded:
            if name in self._places:
                module, _, attribute = self._places[name].partition(":")
                kind = getattr(importlib.import_module(module), attribute)
            elif name in self._offered:
                kind = self._from_entry_point(self._offered[name])
                if name in self._loaded:  # its module has registered it
                    return self._loaded[name]
            else:
                raise UnknownName(self.noun, name, self)
            self._loaded[name] = self._check(name, kind)
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        run_plugins()
        return iter(dict.fromkeys((*self._places, *self._loaded, *self._offered)))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        run_plugins()
        return name in self._places or name in self._loaded or name in self._offered

    @functools.cached_property
    def _offered(self) -> dict[str, importlib.metadata.EntryPoint]:
        """Entry points of installed distributions; a shipped name stays the shipped kind's."""
        found: dict[str, importlib.metadata.EntryPoint] = {}
        for point in importlib.metadata.entry_points(group=self.group):
            if point.name in self._places:
                raise InputError(
                    f"{_origin(point)} offers a {self.noun} named {point.name!r}, which the "
                    "package has already: rename its entry point"
                )
            found.setdefault(point.name, point)
        return found

    def _from_entry_point(self, point: importlib.metadata.EntryPoint) -> Any:
        try:
            return point.load()
        except TwinError:
            raise
        except Exception as error:  # any import can fail in any way
            raise InputError(
                f"{_origin(point)} offers {self.noun} {point.name!r} as {point.value}, which "
                f"cannot be loaded: {type(error).__name__}: {error}"
            ) from error


def _origin(point: importlib.metadata.EntryPoint) -> str:
    return f"distribution {point.dist.name!r}" if point.dist else "an entry point"


_plugins_ran: set[str] = set()


def run_plugins() -> None:
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
