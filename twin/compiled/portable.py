"""Portable: a second compilation of a function, with the same bits on every processor.

The last bit of `math.cos` and similar functions depends on the C library and the instructions that
it chooses. The MuJoCo twin calls `math`, so that the bytes of its stores stay. The batched engine
must give one result everywhere. Both use one source: `portable(function)` compiles the function
again with `twin.compiled.elementary` for `math`, in all compiled functions that it calls too.
Functions that `elementary` lacks stay those of the C library.

The module also lets loops over lanes call a function at an address and use the widest vectors.
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
    """Compile a function made by `jit` or `generate` again, with elementary functions."""
    return function if function.__module__ == elementary.__name__ else _Portable(function)


class _Portable(Compiled):
    def __init__(self, function: Compiled):
        name = f"portable_{function.__name__}"
        super().__init__(
            lambda: _copy(function), name, function.__module__, function.table, **function._options
        )
        self.__doc__ = function.__doc__

    def _content(self) -> str | None:
        stamps = (content.stamp(self.__module__, self), content.stamp(__name__))
        if None in stamps:
            return None
        return hashlib.sha256("\n".join(map(str, stamps)).encode()).hexdigest()[:32]


class _Math(ModuleType):
    """Replacement of the module `math` in compiled code, with the elementary functions."""

    def __getattr__(self, name: str) -> Any:
        return _elementary(name) or getattr(math, name)


_MATH = _Math("math")


def _elementary(name: str) -> Any:
    found = getattr(elementary, name, None)
    return found if isinstance(found, Compiled) else None


def _copy(function: Compiled) -> FunctionType:
    """Copy the Python function with globals replaced by `_replaced`."""
    source: Any = function.py_func
    code, names = source.__code__, content.names_of(source.__code__)
    space = {
        name: _replaced(value, names) for name, value in source.__globals__.items() if name in names
    }
    closure = source.__closure__ and tuple(
        CellType(_replaced(cell.cell_contents, names)) for cell in source.__closure__
    )
    # numba keeps compiled code by the function's name, so the copy needs a name of its own
    name = f"portable_{source.__name__}"
    code = code.replace(co_name=name, co_qualname=f"portable_{code.co_qualname}")
    space["__name__"] = source.__module__ or function.__module__
    again = FunctionType(code, space, name, source.__defaults__, closure)
    again.__qualname__ = code.co_qualname
    return again


def _replaced(value: Any, names: frozenset[str]) -> Any:
    """Replacement of a global's value in portable code."""
    if value is math:
        return _MATH if any(map(_elementary, names)) else math
    if isinstance(value, Compiled):
        return portable(value) if calls_math(value) else value
    if getattr(value, "__module__", None) == "math":
        return _elementary(value.__name__) or value
    return value


def calls_math(function: Compiled, callers: frozenset[Compiled] = frozenset()) -> bool:
    """Tell whether a function uses an elementary function of `math`, directly or through others."""
    if function in callers or function.__module__ == elementary.__name__:
        return False  # a cycle of calls has been searched already
    source: Any = function.py_func
    names = content.names_of(source.__code__)
    used = [value for name, value in source.__globals__.items() if name in names]
    used += [cell.cell_contents for cell in source.__closure__ or ()]
    return any(
        calls_math(value, callers | {function})
        if isinstance(value, Compiled)
        else _replaced(value, names) is not value
        for value in used
    )


@intrinsic
def call_rate(typingctx, function, block, g):  # type: ignore[no-untyped-def]
    """Call the function at the address `function` with the address `block` and the vector `g`.

    The caller keeps function and block alive while the compiled code runs.
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
    """Let the calling function use the widest vectors of the processor.

    By default LLVM uses half of an AVX-512 register, as code with few vectors gains nothing from
    the rest. A loop over lanes consists of vector operations.
    """

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        # llvmlite rejects this attribute, so it goes directly into the underlying set
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), codegen
