"""Compiled functions: numba's, made at the first call and kept by content."""

from __future__ import annotations

import functools
from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar, cast, overload

from twin.compiled import content

R = TypeVar("R")


class Compiled:
    """A function that numba compiles when it is first called or first used by compiled code.

    To other compiled functions it is the numba function itself. After `changed()` it is made again
    if anything in its content (`content.stamp`) is different.
    """

    def __init__(
        self,
        make: Callable[[], FunctionType],
        name: str,
        module: str,
        table: content.Table | None = None,
        **options: Any,
    ):
        self.__name__ = self.__qualname__ = name
        self.__module__ = module or "<unknown>"  # what exec() makes has none
        self.table = table
        """The dispatch table that it is, None: it is none"""
        self._make = make
        self._options = options
        self._generation = -1
        self._stamp: str | None = None
        self._dispatcher: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Run it, compiling first what is new."""
        if self._generation != content._generation:
            self._refresh()
        return self._dispatcher(*arguments)

    @property
    def dispatcher(self) -> Any:
        """numba's object for this function, up to date."""
        if self._generation != content._generation:
            self._refresh()
        return self._dispatcher

    @property
    def _numba_type_(self) -> Any:
        """What numba asks of an object that it meets in compiled code."""
        return self.dispatcher._numba_type_

    @property
    def targetoptions(self) -> dict[str, Any]:
        """numba's options; its inliner reads them."""
        return cast(dict[str, Any], self.dispatcher.targetoptions)

    @property
    def py_func(self) -> FunctionType:
        """The Python function, for the inliner and for tests."""
        return self._make()

    def __reduce__(self) -> str:
        return self.__qualname__

    def __repr__(self) -> str:
        return f"<compiled function {self.__module__}.{self.__qualname__}>"

    def _content(self) -> str | None:
        """Hash of what it is compiled from, None when that cannot be told."""
        return content.stamp(self.__module__, self)

    def _refresh(self) -> None:
        import numba
        from numba.core.compiler_lock import global_compiler_lock

        from twin.compiled.folder import decorated

        # numba's own lock: with a second one, two threads that compile may wait for each other
        with global_compiler_lock:
            generation = content.generation()
            stamp = self._content()
            if self._dispatcher is None or stamp is None or stamp != self._stamp:
                function = self._make()
                self._dispatcher = decorated(
                    lambda cache: numba.njit(
                        cache=cache,
                        no_cfunc_wrapper=True,  # ours are called, never passed as pointers
                        **self._options,
                    )(function),
                    self.__module__,
                    stamp,
                )
            self._stamp, self._generation = stamp, generation


@overload
def jit(function: Callable[..., R], /) -> Callable[..., R]: ...
@overload
def jit(
    *, inline: str = ..., nogil: bool = ..., forceinline: bool = ..., _nrt: bool = ...
) -> Callable[[Callable[..., R]], Callable[..., R]]: ...
def jit(function: Any = None, /, **options: Any) -> Any:
    """Compile a function with numba (nopython, error_model "numpy") at its first call.

    Use it as `@jit` or `@jit(nogil=True)`; options are those of `numba.njit`. Positional arguments
    only. The code is kept between processes, see `twin.compiled.content`.
    """
    if function is None:
        return functools.partial(jit, **options)
    compiled = Compiled(
        lambda: function,
        function.__qualname__,
        function.__module__,
        **{"error_model": "numpy", "_nrt": True, **options},
    )
    compiled.__doc__ = function.__doc__
    return compiled


def borrowing(function: Any = None, /, **options: Any) -> Any:
    """`jit` for a function that makes no array: it counts nobody's references.

    By default each slice of an array that goes to a function adds one to the count of who holds the
    array and takes it off again. For a small function that is a third of its time, and threads wait
    for each other at the count. The caller keeps the arrays while the function runs. It may call
    functions of `jit`; a function that makes an array does not compile so.
    """
    return jit(function, **{"_nrt": False, **options})


def inline(function: Callable[..., R], /) -> Callable[..., R]:
    """`jit` for a function that is always inlined into its callers."""
    return jit(inline="always")(function)


def cfunc(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a C callback of numba's `signature` at once, kept between processes as with `jit`.

    Returns numba's CFunc, whose `address` is good while it lives. Make it again when `generation()`
    has changed: a callback holds copies of what it calls.
    """
    import numba
    from numba.core.compiler_lock import global_compiler_lock

    from twin.compiled.folder import decorated

    def compile_now(function: Callable[..., Any]) -> Any:
        with global_compiler_lock:
            settings = {"error_model": "numpy", **options}
            module = function.__module__ or "<unknown>"
            return decorated(
                lambda cache: numba.cfunc(signature, cache=cache, **settings)(function),
                module,
                content.stamp(module, function),
            )

    return compile_now
