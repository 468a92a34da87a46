"""Flow: the current and its gradient at a point, by code that is compiled when one is first met.

Samplers hold the kernel of every kind of current, an eighth of what a first flight would compile,
and most flights have still water. The callbacks therefore call the sampler by its address, which
is 0 until a current flows, and after a kind of current was registered.
"""

from __future__ import annotations

import ctypes
from typing import Any

from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from twin.compiled import cfunc, generation, jit
from twin.physics.native.access import load_i8
from twin.water.current.sampler import sample_gradient

FLOW = 15
"""Numbers of `sample_gradient`"""

flow_table = types.ExternalFunction("glider_twin_flow", types.int64())
"""Address of TABLE"""
TABLE = (ctypes.c_int64 * 2)()
"""Addresses of the sampler, 0: not compiled, and of what compiles it"""

_DOUBLE, _WORD = ir.DoubleType(), ir.IntType(64)
_POINTER = types.CPointer(types.float64)
_SIGNATURE = types.void(_POINTER, types.int64, *(types.float64,) * 4, _POINTER)
_kept: list[Any] = []
"""Samplers of every generation: other threads may be running an older one"""
_made = -1


def sampled(program, size, time, north, east, down, out):  # type: ignore[no-untyped-def]
    """`sample_gradient` as a C function."""
    found, flow = sample_gradient(carray(program, size), time, north, east, down), carray(out, FLOW)
    for i in range(FLOW):
        flow[i] = found[i]


def prepare() -> None:
    """Compile the sampler, unless it is the one of today's kinds."""
    global _made
    if TABLE[0] == 0 or _made != generation():
        now = generation()
        _kept.append(cfunc(_SIGNATURE)(sampled))
        TABLE[0], _made = _kept[-1].address, now


def renew() -> None:
    """Have it compiled again, when it is needed, if a kind was registered since."""
    if _made != generation():
        TABLE[0] = 0


@ctypes.CFUNCTYPE(None)
def _prepare() -> None:
    prepare()


TABLE[1] = ctypes.cast(_prepare, ctypes.c_void_p).value or 0


@intrinsic
def _call(typingctx, address):  # type: ignore[no-untyped-def]
    """Call the function without arguments at an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        kind = ir.FunctionType(ir.VoidType(), [])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), [])
        return context.get_dummy_value()

    return types.void(types.int64), codegen


@intrinsic
def _sampled_at(typingctx, address, program, size, t, north, east, down):  # type: ignore[no-untyped-def]
    """What the sampler at `address` finds: `sample_gradient` of the program at an address."""
    result = types.UniTuple(types.float64, FLOW)
    point = (types.float64,) * 4

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        pointer = _DOUBLE.as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, _WORD, *(_DOUBLE,) * 4, pointer])
        with builder.goto_entry_block():
            out = builder.alloca(_DOUBLE, FLOW)
        call, first, words, *place = args
        target = builder.inttoptr(call, kind.as_pointer())
        builder.call(target, [builder.inttoptr(first, pointer), words, *place, out])
        found = [builder.load(builder.gep(out, [ir.Constant(_WORD, i)])) for i in range(FLOW)]
        return context.make_tuple(builder, result, found)

    return result(types.int64, types.int64, types.int64, *point), codegen


@jit
def flow_at(program, t, north, east, down):  # type: ignore[no-untyped-def]
    """`sample_gradient` of a current's program in a model's block."""
    table = flow_table()
    address = load_i8(table)
    if address == 0:
        _call(load_i8(table + 8))
        address = load_i8(table)
    return _sampled_at(address, program.ctypes.data, program.size, t, north, east, down)
