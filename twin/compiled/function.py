"""Compiled functions: numba's, made at the first call and kept by content.

Generated ones have a body that is written as text, such as a branch for each kind of a table.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import Any, TypeVar, overload

from twin.compiled import content

R = TypeVar("R")


class Compiled:
    """A function that numba compiles when it is first called or first used by compiled code.

    To other compiled functions it is a numba function that Python cannot call, since most are never
    called by Python and the way in takes a tenth of compiling; Python calls a second one, made when
    it first does. After `changed()` they are made again if anything in their content
    (`content.stamp`) is different.
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
        self._called: Any = None
        self._inner: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Run it, compiling first what is new."""
        if self._generation != content._generation or self._called is None:
            return self.dispatcher(*arguments)
        return self._called(*arguments)

    @property
    def dispatcher(self) -> Any:
        """numba's object for this function, up to date, for calls by Python."""
        if self._generation != content._generation or self._called is None:
            self._refresh(inner=False)
        return self._called

    @property
    def _numba_type_(self) -> Any:
        """Type that numba asks of an object in compiled code."""
        if self._generation != content._generation or self._inner is None:
            self._refresh(inner=True)
        return self._inner._numba_type_

    @property
    def targetoptions(self) -> dict[str, Any]:
        """numba's options; its inliner reads them."""
        return dict(self._options)

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

    def _refresh(self, *, inner: bool) -> None:
        from numba.core.compiler_lock import global_compiler_lock

        # numba's own lock: with a second one, two threads that compile may wait for each other
        with global_compiler_lock:
            if (generation := content.generation()) != self._generation:
                stamp = self._content()
                if stamp is None or stamp != self._stamp:
                    self._called = self._inner = None
                self._stamp, self._generation = stamp, generation
            if inner and self._inner is None:
                self._inner = self._decorated(no_cpython_wrapper=True)
            if not inner and self._called is None:
                self._called = self._decorated()

    def _decorated(self, **options: bool) -> Any:
        import numba

        from twin.compiled.folder import decorated

        # ours are called, never passed as pointers
        settings = {"no_cfunc_wrapper": True, **options, **self._options}
        return decorated(
            lambda cache: numba.njit(cache=cache, **settings)(self._make()),
            self.__module__,
            self._stamp,
            "inner" if options else "",
        )


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
    """`jit` for a function that LLVM always inlines into its callers.

    numba's own inlining, `inline="always"`, types and lowers the function again at each call.
    """
    return jit(forceinline=True)(function)


def cfunc(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a C callback of numba's `signature` at once, kept between processes as with `jit`.

    Returns numba's CFunc, whose `address` is good while it lives. Make it again when `generation()`
    has changed: a callback holds copies of what it calls.
    """
    import numba
    from numba.core.compiler_lock import global_compiler_lock

    from twin.compiled.folder import decorated

    def compile_now(function: Callable[..., Any]) -> Any:
        with global_compiler_lock:
            module = function.__module__ or "<unknown>"
            return decorated(
                lambda cache: numba.cfunc(signature, cache=cache, error_model="numpy")(function),
                module,
                content.stamp(module, function),
            )

    return compile_now


Written = tuple[str, Mapping[str, Any]]
"""Source text of a function's body, and what its names mean (compiled functions, numbers)."""


def dispatch(
    name: str,
    arguments: Sequence[str],
    kernels: Callable[[], Mapping[int, Any]],
    fallback: tuple[float, ...] | float,
    *,
    module: str,
    **options: Any,
) -> Compiled:
    """A compiled function `name(code, *arguments)` that calls the kernel of that code.

    A C callback cannot call Python and holds copies of what it calls: compiled code must choose.

    Args:
      name: of the function, unique in its module.
      arguments: names that every kernel takes, in order.
      kernels: returns functions made by `jit`, by code, that all return a float, or tuples of one
        length. Call `changed()` when it has others.
      fallback: what an unknown code returns: a float, or a tuple of the kernels' length.
      module: `__name__` of the caller; the function is part of the content of what calls it.
      options: of `jit`.

    Raises:
      TypeError: when it is compiled, and a kernel was not made by `jit`.
      ValueError: the module has a generated function of that name already.
    """

    def write() -> Written:
        table = sorted(kernels().items())
        call = f"({', '.join(arguments)})"
        lines = [f"if code == {code}: return _kernel_{code}{call}" for code, _ in table]
        names = {f"_kernel_{code}": kernel for code, kernel in table}
        return "\n".join([*lines, "return _fallback"]), {**names, "_fallback": fallback}

    return generate(name, ("code", *arguments), write, module=module, **options)


def generate(
    name: str,
    arguments: Sequence[str],
    write: Callable[[], Written],
    *,
    module: str,
    **options: Any,
) -> Compiled:
    """A compiled function whose body is written by `write()`, again after each `changed()`.

    The body's lines are not indented. Its content is the text and that of every compiled function
    among its names. `module` is `__name__` of the caller; options are those of `jit`. Raises as
    `dispatch`.
    """
    if name in content._tables[module]:
        raise ValueError(f"{module} has a generated function {name!r} already: choose another name")

    def written() -> tuple[str, Mapping[str, Any]]:
        body, names = write()
        for key, value in names.items():
            if callable(value) and not isinstance(value, Compiled):
                raise TypeError(f"{name}: {key} is {value!r}; decorate it with twin.compiled.jit")
        lines = "".join(f"    {line}\n" for line in body.splitlines())
        return f"def {name}({', '.join(arguments)}):\n{lines}", names

    def text() -> tuple[str, tuple[str, ...]]:
        source, names = written()
        kernels = tuple(v.__module__ for v in names.values() if isinstance(v, Compiled))
        # the names of compiled functions tell two of one module apart
        return f"{source}\n{dict(names)!r}", kernels

    @functools.lru_cache(maxsize=1)
    def made(_: int) -> FunctionType:
        source, names = written()
        space = {"__name__": module, **names}
        exec(compile(source, f"<generated {name}>", "exec"), space)
        return space[name]

    return Compiled(
        lambda: made(content.generation()),
        name,
        module,
        content.add_table(module, name, text),
        **{"error_model": "numpy", **options},
    )
