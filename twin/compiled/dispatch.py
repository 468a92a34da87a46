"""Dispatch: one compiled function of a table of kinds, for C callbacks that cannot call Python.

A C callback holds copies of what it calls, so which kernel runs must be chosen in compiled code.
Source text with one branch for each kind is written, and compiled like any other function. Its
content is that text and the content of every kernel's module.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import Any

from twin.compiled import content
from twin.compiled.function import Compiled

Written = tuple[str, Mapping[str, Any]]
"""Source text of a function's body, and what its names mean (compiled functions, numbers)."""


def dispatch(
    name: str,
    arguments: Sequence[str],
    kernels: Mapping[int, Any] | Callable[[], Mapping[int, Any]],
    fallback: tuple[float, ...] | float,
    *,
    module: str,
    **options: Any,
) -> Compiled:
    """A compiled function `name(code, *arguments)` that calls the kernel of that code.

    Args:
      name: of the function, unique in its module.
      arguments: names that every kernel takes, in order.
      kernels: functions made by `jit`, by code, all returning a float, or tuples of one length;
        or a function that returns them, for a registry that grows: call `changed()` when it did.
      fallback: what an unknown code returns: a float, or a tuple of the kernels' length.
      module: `__name__` of the caller; the function is part of the content of what calls it.
      options: of `numba.njit`, such as inline="always" for what runs at every step.

    Raises:
      TypeError: a kernel was not made by `jit`.
      ValueError: the module has a generated function of that name already.
    """

    def write() -> Written:
        table = kernels() if callable(kernels) else kernels
        names: dict[str, Any] = {
            "_fallback": tuple(map(float, fallback))
            if isinstance(fallback, tuple)
            else float(fallback)
        }
        lines = []
        for code, kernel in sorted(table.items()):
            names[f"_kernel_{code}"] = kernel
            lines.append(f"if code == {int(code)}: return _kernel_{code}({', '.join(arguments)})")
        return "\n".join([*lines, "return _fallback"]), names

    if not callable(kernels):
        _kernels_of(name, write()[1])
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

    The body's lines are not indented. `module` is `__name__` of the caller; options are those of
    `jit`. Raises as `dispatch`.
    """
    if name in content._tables[module]:
        raise ValueError(f"{module} has a generated function {name!r} already: choose another name")

    def text() -> tuple[str, tuple[str, ...]]:
        body, names = write()
        kernels = _kernels_of(name, names)
        constants = {key: value for key, value in names.items() if key not in kernels}
        # The kernels' names tell two functions of one module apart.
        used = [f"{key}={kernel!r}" for key, kernel in kernels.items()]
        written = "\n".join([_source(name, arguments, body), *used, repr(constants)])
        return written, tuple(kernel.__module__ for kernel in kernels.values())

    @functools.lru_cache(maxsize=1)
    def made(_: int) -> FunctionType:
        body, names = write()
        space = {"__name__": module, **names}
        exec(compile(_source(name, arguments, body), f"<generated {name}>", "exec"), space)
        return space[name]

    table = content.add_table(module, name, text)
    return Compiled(
        lambda: made(content.generation()),
        name,
        module,
        table,
        **{"error_model": "numpy", **options},
    )


def _source(name: str, arguments: Sequence[str], body: str) -> str:
    lines = "".join(f"    {line}\n" for line in body.splitlines())
    return f"def {name}({', '.join(arguments)}):\n{lines}"


def _kernels_of(name: str, names: Mapping[str, Any]) -> dict[str, Compiled]:
    """The compiled functions among the names; raises TypeError at functions that are not."""
    for key, value in names.items():
        if callable(value) and not isinstance(value, Compiled):
            raise TypeError(f"{name}: {key} is {value!r}; decorate it with twin.compiled.jit")
    return {key: value for key, value in names.items() if isinstance(value, Compiled)}
