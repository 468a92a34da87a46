"""Functions compiled by numba at the first call and kept by their content.

The body of a generated function is written as text, such as a branch for each type of a table.
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

    Compiled code gets a numba function without a Python wrapper, which would take a tenth of
    compile time and is seldom used. The first call by Python makes a second one with the wrapper.
    After `changed()` both are made again if anything in their content (`content.stamp`) is
    different.
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
        self.__module__ = module or "<unknown>"  # functions made by exec() have no module
        self.table = table
        """Dispatch table that this function is; None: it is none."""
        self._make = make
        self._options = options
        self._generation = -1
        self._stamp: str | None = None
        self._called: Any = None
        self._inner: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Run the function, compiling it first if necessary."""
        if self._generation != content._generation or self._called is None:
            return self.dispatcher(*arguments)
        return self._called(*arguments)

    @property
    def dispatcher(self) -> Any:
        """Up-to-date numba dispatcher of this function, for calls by Python."""
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
        """numba's options, which its inliner reads."""
        return dict(self._options)

    @property
    def py_func(self) -> FunctionType:
        """Python function, for the inliner and for tests."""
        return self._make()

    def __reduce__(self) -> str:
        return self.__qualname__

    def __repr__(self) -> str:
        return f"<compiled function {self.__module__}.{self.__qualname__}>"

    def _content(self) -> str | None:
        """Hash of the source that the function is compiled from; None when it is unknown."""
        return content.stamp(self.__module__, self)

    def _refresh(self, *, inner: bool) -> None:
        from numba.core.compiler_lock import global_compiler_lock

        # numba's own lock: with a second lock, two compiling threads could deadlock
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

        # these functions are called, never passed as pointers
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

    Used as `@jit` or `@jit(nogil=True)`; options are those of `numba.njit`. Positional arguments
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
    """Compile a function that makes no array, without reference counting.

    By default each array slice passed to a function raises and lowers the array's reference count.
    For a small function that is a third of its time, and threads wait for each other at the count.
    The caller keeps the arrays alive. The function may call functions of `jit`; one that makes an
    array does not compile.
    """
    return jit(function, **{"_nrt": False, **options})


def inline(function: Callable[..., R], /) -> Callable[..., R]:
    """Compile a function that LLVM always inlines into its callers.

    numba's own inlining, `inline="always"`, types and lowers the function again at each call.
    """
    return jit(forceinline=True)(function)


def cfunc(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a C callback of numba's `signature` at once, kept between processes as with `jit`.

    Returns numba's CFunc, whose `address` is valid while it lives. Make it again when
    `generation()` has changed: a callback holds copies of the functions that it calls.
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
"""Source text of a function's body, and the objects of its names (compiled functions, numbers)."""


def dispatch(
    name: str,
    arguments: Sequence[str],
    kernels: Callable[[], Mapping[int, Any]],
    fallback: tuple[float, ...] | float,
    *,
    module: str,
    **options: Any,
) -> Compiled:
    """Make a compiled function `name(code, *arguments)` that calls the kernel of that code.

    A C callback cannot call Python and holds copies of its callees, so compiled code must choose.

    Args:
      name: of the function, unique in its module.
      arguments: names that every kernel takes, in order.
      kernels: returns functions made by `jit`, by code, that all return a float, or tuples of one
        length. Call `changed()` when the kernels change.
      fallback: value for an unknown code: a float, or a tuple of the kernels' length.
      module: `__name__` of the caller; the function is part of the content of its callers.
      options: of `jit`.

    Raises:
      TypeError: at compilation, when a kernel was not made by `jit`.
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
    """Make a compiled function whose body `write()` writes, again after each `changed()`.

    The body's lines are not indented. The content is the text and the content of every compiled
    function among its names. `module` is `__name__` of the caller; options are those of `jit`.
    Raises as `dispatch`.
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
        # the names distinguish two compiled functions of one module
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
