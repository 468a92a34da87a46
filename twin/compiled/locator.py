"""Locator: tells numba where a function's code is kept and what it was made from.

Named to numba by `numba.config.CACHE_LOCATOR_CLASSES`, numba's own setting for this purpose.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from types import FunctionType
from typing import Self, TypeVar

import numba
from numba.core.caching import _CacheLocator

from twin.compiled.folder import cache_root, version_folder

T = TypeVar("T")

_now: ContextVar[tuple[str, str]] = ContextVar("module and stamp of what is being decorated")


class ContentLocator(_CacheLocator):
    """One folder for each version of each module, so that versions never share an index."""

    def __init__(self, function: FunctionType, file: str) -> None:
        module, self._stamp = _now.get()
        root = cache_root()
        assert root is not None
        self._folder = version_folder(root, f"{module}-{self._stamp}")
        self._line = function.__code__.co_firstlineno
        self._py_file = file  # numba names it in warnings

    def get_cache_path(self) -> str:
        """The folder of this version."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Create the folder; raises OSError when it cannot be written."""
        self._folder.mkdir(mode=0o700, exist_ok=True)
        tempfile.TemporaryFile(dir=self._folder).close()

    def get_source_stamp(self) -> str:
        """The content's hash."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """The line of the function: two of one name in a module are told apart."""
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: FunctionType, py_file: str) -> Self:
        """numba's entry."""
        return cls(py_func, py_file)


def decorated(decorate: Callable[[bool], T], module: str, stamp: str | None) -> T:
    """What `decorate(cache)` returns when numba asks `ContentLocator`; not kept without a stamp."""
    if stamp is None or cache_root() is None:
        return decorate(False)
    with _located(module, stamp):
        return decorate(True)


@contextlib.contextmanager
def _located(module: str, stamp: str) -> Iterator[None]:
    before = numba.config.CACHE_LOCATOR_CLASSES
    token = _now.set((module, stamp))
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{ContentLocator.__name__}"
    try:
        yield
    finally:
        numba.config.CACHE_LOCATOR_CLASSES = before
        _now.reset(token)
