"""Portable: a compiled function once more, with the same bits on every processor.

The last bit of what `math.cos` and its like return depends on the C library and on the instructions
that it finds. MuJoCo's twin calls them and keeps its bytes; the lanes give one result everywhere.
Both run the same source: `portable(function)` is the function compiled a second time, in which
`math` means `twin.compiled.elementary` wherever that has a function of the name, and so in every
compiled function that it calls. A function of the C library that is not there stays.

Loops over lanes also call a function at an address, and use the widest vectors.
"""

from __future__ import annotations

import functools
import hashlib
import math
from types import CellType, FunctionType, ModuleType
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from twin.compiled import content, elementary
from twin.compiled.function import Compiled


@functools.cache
def portable(function: Any) -> Any:
    """A function made by `jit` or `generate`, compiled with elementary functions."""
    return function if function.__module__ == elementary.__name__ else _Portable(function)


class _Portable(Compiled):
    def __init__(self, function: Compiled):
        name = f"portable_{function.__name__}"
        super().__init__(
            lambda: _again(function), name, function.__module__, function.table, **function._options
        )
        self.__doc__ = function.__doc__

    def _content(self) -> str | None:
        stamps = (content.stamp(self.__module__, self), content.stamp(__name__))
        if None in stamps:
            return None
        return hashlib.sha256("\n".join(map(str, stamps)).encode()).hexdigest()[:32]


class _Math(ModuleType):
    """The module `math` to compiled code, with the elementary functions in it."""

    def __getattr__(self, name: str) -> Any:
        return _elementary(name) or getattr(math, name)


_MATH = _Math("math")


def _elementary(name: str) -> Any:
    found = getattr(elementary, name, None)
    return found if isinstance(found, Compiled) else None


def _again(function: Compiled) -> FunctionType:
    """The Python function with other globals: what it calls is what `_other` says."""
    source: Any = function.py_func
    code, names = source.__code__, content.names_of(source.__code__)
    space = {
        name: _other(value, names) for name, value in source.__globals__.items() if name in names
    }
    closure = source.__closure__ and tuple(
        CellType(_other(cell.cell_contents, names)) for cell in source.__closure__
    )
    # numba keeps compiled code by the function's name: the two must not have one
    name = f"portable_{source.__name__}"
    code = code.replace(co_name=name, co_qualname=f"portable_{code.co_qualname}")
    space["__name__"] = source.__module__ or function.__module__
    again = FunctionType(code, space, name, source.__defaults__, closure)
    again.__qualname__ = code.co_qualname
    return again


def _other(value: Any, names: frozenset[str]) -> Any:
    """Value of a name in portable code."""
    if value is math:
        return _MATH if any(map(_elementary, names)) else math
    if isinstance(value, Compiled):
        return portable(value) if calls_math(value) else value
    if getattr(value, "__module__", None) == "math":
        return _elementary(value.__name__) or value
    return value


def calls_math(function: Compiled, above: frozenset[Compiled] = frozenset()) -> bool:
    """Whether it, or what it calls, has something of `math` that is elementary here."""
    if function in above or function.__module__ == elementary.__name__:
        return False  # `above`: those that call it
    source: Any = function.py_func
    names = content.names_of(source.__code__)
    used = [value for name, value in source.__globals__.items() if name in names]
    used += [cell.cell_contents for cell in source.__closure__ or ()]
    return any(
        calls_math(value, above | {function})
        if isinstance(value, Compiled)
        else _other(value, names) is not value
        for value in used
    )


@intrinsic
def call_rate(typingctx, function, block, g):  # type: ignore[no-untyped-def]
    """Call the structure's function at an address with the block at another one.

    The caller keeps both alive while the compiled code runs.
    """

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        double = ir.DoubleType()
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [double.as_pointer(), double])
        target = builder.inttoptr(args[0], kind.as_pointer())
        address = builder.bitcast(builder.inttoptr(args[1], pointer), double.as_pointer())
        builder.call(target, [address, args[2]])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), codegen


@intrinsic
def widest_vectors(typingctx):  # type: ignore[no-untyped-def]
    """Let the function that calls this use the widest vectors that the processor has.

    LLVM takes halves of AVX-512's registers by itself, since code with few vectors gains nothing
    from the rest. A loop over lanes is vectors throughout.
    """

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        # llvmlite knows no such attribute, but writes what the set has
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), codegen
