"""Registry: the kinds of one seam by name, the package's own and those of a user.

A kind comes in by `REGISTRY.register(kind)`, or by an entry point of another distribution in the
registry's group, which is loaded when the kind is first asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from twin.errors import InputError, TwinError, unknown_name

Kind = TypeVar("Kind")


class Registry(Generic[Kind]):
    """Kinds by name, in the order in which they came in."""

    def __init__(
        self,
        noun: str,
        *,
        group: str,
        name: Callable[[Kind], str],
        check: Callable[[Kind], str] = lambda kind: "",
        error: type[TwinError] = InputError,
    ):
        """A registry without kinds.

        Args:
          noun: what a message calls a kind, such as "vehicle part".
          group: of the entry points through which other distributions add kinds.
          name: the name of a kind.
          check: what a kind lacks, as the end of "... lacks"; empty when nothing.
          error: class of the errors for unknown and unusable kinds.
        """
        self.noun, self.group = noun, group
        self._name, self._check, self._error = name, check, error
        self._kinds: dict[str, Kind] = {}
        self._discovered = False
        self.version = 0
        """Counts the changes; what was built from an older version is out of date."""

    def register(self, kind: Kind) -> Kind:
        """Add a kind; usable as a decorator.

        Raises:
          the registry's error: it is only half there, or another kind has its name.
        """
        name = self._name(kind)
        if not name:
            raise self._error(f"a {self.noun} needs a name: {kind!r} has none")
        lacks = self._check(kind)
        if lacks:
            raise self._error(f"{self.noun} {name!r} is only half there: it lacks {lacks}")
        present = self._kinds.get(name)
        if present is not None and not _same(present, kind):
            raise self._error(f"there is a {self.noun} {name!r} already: choose another name")
        self._kinds[name] = kind
        self.version += 1
        return kind

    def unregister(self, name: str) -> None:
        """Take a kind out again; raises the registry's error when there is none."""
        self[name]
        del self._kinds[name]
        self.version += 1

    def _discover(self) -> None:
        if self._discovered:
            return
        self._discovered = True
        from importlib.metadata import entry_points

        for entry in entry_points(group=self.group):
            if entry.name not in self._kinds:
                self.register(entry.load())

    def __getitem__(self, name: str) -> Kind:
        if name not in self._kinds:
            self._discover()
        if name not in self._kinds:
            raise self._error(unknown_name(self.noun, str(name), self._kinds))
        return self._kinds[name]

    def __contains__(self, name: object) -> bool:
        self._discover()
        return name in self._kinds

    def __iter__(self) -> Iterator[str]:
        self._discover()
        return iter(tuple(self._kinds))

    def __len__(self) -> int:
        self._discover()
        return len(self._kinds)

    def kinds(self) -> tuple[Kind, ...]:
        """All kinds, in the order of their registration."""
        self._discover()
        return tuple(self._kinds.values())

    def code(self, name: str) -> int:
        """Number by which compiled code knows a kind, from 1: its place in the registry."""
        self[name]
        return 1 + list(self._kinds).index(name)


def _same(one: object, other: object) -> bool:
    """Whether two registrations mean the same kind, as after a module was loaded twice."""
    return one is other or (
        getattr(one, "__module__", None) == getattr(other, "__module__", ())
        and getattr(one, "__qualname__", None) == getattr(other, "__qualname__", ())
    )
