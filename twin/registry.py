"""Registry: the types of one extension point by name: shipped, registered, or from entry points.

Each type is imported when its name is first looked up. Shipped types are known by their import
place (`twin.seams`). An installed distribution adds types under the group of entry points:

    [project.entry-points."glider_twin.sensors"]
    turbidity = "my_package.turbidity:Turbidity"

For types in a single file, the environment variable `GLIDER_TWIN_PLUGINS` names Python files that
call `register`, separated as in PATH. Worker processes inherit the variable and so know the same
types. `registered` and `adopt` hand over to workers the types that a program registers itself.
"""

from __future__ import annotations

import functools
import importlib.metadata
import re
import zlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from twin import plugins
from twin.errors import InputError, TwinError, UnknownName
from twin.plugins import PLUGIN_MODULE, PLUGINS, PROGRAMS, imported, place_of, run_plugins

Kind = TypeVar("Kind")
NAMES = re.compile(r"\w[\w-]*")
"""Pattern of a type's name, which stands in files and on command lines"""


class Registry(Mapping[str, Kind]):
    """Types by name, in the order in which they became known; a type is checked when it is loaded.

    An unknown name raises `UnknownName`, which is an `InputError` and a `KeyError`.
    """

    def __init__(
        self,
        noun: str,
        *,
        group: str,
        base: str = "",
        folder: str = "",
        page: str = "",
        shipped: Mapping[str, str] | None = None,
        apart: Mapping[str, str] | None = None,
        name: str = "name",
        words: tuple[str, ...] = (),
        objects: bool = False,
        error: type[TwinError] = InputError,
        check: Callable[[str, Any], Kind] | str = "",
        check_shipped: bool = True,
        former: str = "",
        compiled: bool = False,
    ):
        """Make the registry of one extension point.

        Args:
          noun: name of a type in errors, such as "sensor".
          group: group of the entry points that add types.
          base: base class, `package.Name`. Its method `flaw`, if there is one, returns the defect
            of a type as a clause; an empty text means no defect.
          folder: folder of the shipped types.
          page: page of docs/, with its anchor, that shows how to write a type of your own.
          shipped: places `package.module:attribute` of the shipped types, by name.
          apart: folders below this project's `plugins/` that bring further types, by type name.
          name: attribute in which a type holds its name; empty if types hold no name.
          words: attributes that must hold a text.
          objects: registered types are objects of `base`, not classes.
          error: class of the error for an incomplete type.
          check: function that replaces the checks above for functions: returns the type or raises.
            A text `package.module:function` is imported at the first check.
          check_shipped: check shipped types when they are loaded; if False only tests check them.
          former: group of entry points that an older version used.
          compiled: compiled functions have a branch for each type, and are compiled again when
            types come or go.
        """
        self.noun, self.group = noun, group
        self.folder, self.base, self.page = folder, base, page
        self._places, self._apart = dict(shipped or {}), dict(apart or {})
        self._name, self._words, self._objects = name, words, objects
        self._error, self._check, self._check_shipped = error, check, check_shipped
        self._groups = (group, former) if former else (group,)
        self._compiled = compiled
        self._registered: dict[str, Kind] = {}
        self._loaded: dict[str, Kind] = {}

    def add(self, kind: Any) -> Any:
        """Register a type under its own name and return the type: a decorator."""
        name = getattr(kind, self._name, "")
        if not isinstance(name, str) or not name:
            raise InputError(
                f"{kind!r} cannot be registered as a {self.noun}: it has no {self._name}"
            )
        self.register(name, kind)
        return kind

    def register(self, name: str, kind: Any = None) -> Any:
        """Add a type of your own for this process; `@REGISTRY.register(name)` decorates a type.

        A type may be registered twice. A class or function that is defined again at the same
        place, as when a notebook's cell runs twice, replaces the first. A registered type takes
        precedence over an installed distribution's type of that name, usually the same type.

        Raises:
          InputError: the name is taken by another type, or the type is incomplete.
        """
        if kind is None:
            return functools.partial(self.register, name)
        before = self._registered.get(name)
        if before is kind or (name in self._places and self[name] is kind):
            return kind
        if name in self._places or (before is not None and not plugins.same_place(before, kind)):
            raise self._error(f"{self.noun} {name!r} exists already: choose another name")
        try:
            self._check_among(self._registered, name, kind)
        except BaseException:
            if before is not None:
                self._registered[name] = before
            raise
        self._changed()
        return kind

    def _check_among(self, kinds: dict[str, Kind], name: str, kind: Any) -> None:
        """Add a type to `kinds`, and remove it if its check fails; the check may look it up."""
        kinds[name] = kind
        try:
            kinds[name] = self.check(name, kind)
        except BaseException:
            del kinds[name]
            raise

    def unregister(self, name: str) -> None:
        """Remove a type that `register` added; raise UnknownName if there is none of that name."""
        if name not in self._registered:
            raise UnknownName(f"registered {self.noun}", name, self._registered)
        del self._registered[name]
        self._changed()

    def _changed(self) -> None:
        if self._compiled:
            imported("twin.compiled:changed")()

    def check(self, name: str, kind: Any) -> Kind:
        """Return the type if it is complete; raise an error that names the defect otherwise."""
        if self._check:
            check: Any = imported(self._check) if isinstance(self._check, str) else self._check
            return check(name, kind)
        if flaw := self._flaw(name, kind):
            place = f" ({place_of(kind)})" if isinstance(kind, type) else ""
            raise self._error(f"{self.noun} {name!r} is only half there: {flaw}{place}")
        return kind

    def _flaw(self, name: str, kind: Any) -> str:
        """Defect of a type as a clause; empty if there is none."""
        base = imported(":".join(self.base.rsplit(".", 1)))
        derived = isinstance(kind, type) and issubclass(kind, base)
        if not (isinstance(kind, base) if self._objects else derived):
            form = "an object of" if self._objects else "a class derived from"
            return f"{kind!r} must be {form} {self.base}"
        if not NAMES.fullmatch(name):
            return "its name must be of letters, digits, - and _"
        if self._name and (own := getattr(kind, self._name, "")) != name:
            return f"its `{self._name}` is {own!r}"
        if missing := sorted(getattr(kind, "__abstractmethods__", ())):
            return f"it lacks the method {', '.join(f'`{method}`' for method in missing)}"
        for word in self._words:
            text = getattr(kind, word, None)
            if not (isinstance(text, str) and text.strip()):
                return f"it lacks `{word}`, a text of one line for tables and messages"
        return kind.flaw(name) if hasattr(kind, "flaw") else ""

    def code(self, name: str) -> int:
        """Number by which compiled code knows a type, equal in every process."""
        self[name]
        return zlib.crc32(name.encode())

    def kernels(self, attribute: str) -> dict[int, Any]:
        """Compiled functions in one attribute of all types, by the types' codes, without None."""
        found = {self.code(name): getattr(kind, attribute) for name, kind in self.items()}
        return {code: kernel for code, kernel in found.items() if kernel is not None}

    def loaded(self) -> tuple[Kind, ...]:
        """Types that have been loaded or registered so far."""
        return (*self._loaded.values(), *self._registered.values())

    def registered(self) -> dict[str, Kind]:
        """Registered types that must be handed to another process: types that no file named by
        `GLIDER_TWIN_PLUGINS` registers there by itself."""
        return {
            name: kind for name, kind in self._registered.items() if not plugins.from_plugin(kind)
        }

    def adopt(self, kinds: Mapping[str, Any]) -> None:
        """Register in this process the types that `registered` returned in another process."""
        run_plugins()
        for name, kind in kinds.items():
            if name not in self._registered:
                self.register(name, kind)

    def check_importable(self, name: str) -> None:
        """Check that another process can import a type.

        Raises:
          InputError: the type's module cannot be imported there, as for a type in a notebook.
        """
        kind = self.registered().get(name)
        if kind is not None and not plugins.importable(kind):
            raise InputError(
                f"{self.noun} {name!r} ({place_of(kind)}) cannot be imported by another process: "
                f"put it at the top of a file and name the file in {PLUGINS}, or use 1 worker"
            )

    def place(self, name: str) -> str:
        """Place `module:Name` of a type that is not shipped; empty for a shipped type."""
        return "" if name in self._places else place_of(self[name])

    def unknown(self, name: str, place: str = "") -> UnknownName:
        """Make the error for an unknown name.

        Args:
          place: place of the type that a file recorded, as the method `place` returned it.
        """
        if name in self._apart:
            hint = f"; {name} {self.source(name)}"
            return UnknownName(self.noun, name, self, hint=hint)
        module = place.partition(":")[0]
        if module.startswith(PLUGIN_MODULE):
            ways = f"name the file {module.removeprefix(PLUGIN_MODULE)}.py in {PLUGINS}"
        elif module and module not in PROGRAMS:
            ways = f"import {module}, which registers it"
        else:
            ways = f"name its file in {PLUGINS}, or install it with the entry point {self.group}"
        return UnknownName(self.noun, name, self, hint=f"; for one of your own, {ways}")

    def source(self, name: str) -> str:
        """Text that says which plugin of this project brings a missing type."""
        return f"comes with a plugin: {plugins.installation(self._apart[name])}"

    def shipped(self) -> tuple[str, ...]:
        """Names of the types that come with the package."""
        return tuple(self._places)

    def names(self) -> tuple[str, ...]:
        """Names of all types, without importing those of installed distributions."""
        return tuple(self)

    def __getitem__(self, name: str) -> Kind:
        run_plugins()
        if name in self._registered:
            return self._registered[name]
        if name not in self._loaded:
            if name in self._places:
                kind = imported(self._places[name])
            elif name in self._offered:
                kind = plugins.load_entry_point(self._offered[name], f"{self.noun} {name!r}")
                if name in self._registered:  # its module has registered it
                    return self._registered[name]
            else:
                raise self.unknown(name)
            if self._check_shipped or name not in self._places:
                self._check_among(self._loaded, name, kind)
            else:
                self._loaded[name] = kind
            if name not in self._places:
                self._changed()
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        run_plugins()
        return iter(dict.fromkeys((*self._places, *self._registered, *self._offered)))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        run_plugins()
        return name in self._places or name in self._registered or name in self._offered

    @functools.cached_property
    def _offered(self) -> dict[str, importlib.metadata.EntryPoint]:
        """Entry points of installed distributions; raise InputError if one has a shipped name."""
        found: dict[str, importlib.metadata.EntryPoint] = {}
        for group in self._groups:
            for point in importlib.metadata.entry_points(group=group):
                if point.name in self._places:
                    offer = f"{plugins.origin_of(point)} offers a {self.noun} named {point.name!r}"
                    raise InputError(
                        f"{offer}, which the package has already: rename its entry point"
                    )
                found.setdefault(point.name, point)
        return found
