"""Raw memory access for native code: addresses are plain 64-bit integers.

MuJoCo hands its callbacks two pointers. Numba sees them as integers, and these intrinsics
load, store and wrap what lies behind them. Nothing here checks bounds; `struct_offsets`
proves the addresses before any callback is installed.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_I64 = ir.IntType(64)
_F64 = ir.DoubleType()


def _pointer(builder, address, element):
    return builder.inttoptr(address, element.as_pointer())


@intrinsic
def load_f8(typingctx, address):
    """The float64 at `address`."""

    def codegen(context, builder, signature, args):
        return builder.load(_pointer(builder, args[0], _F64))

    return types.float64(types.int64), codegen


@intrinsic
def load_i8(typingctx, address):
    """The int64 (or pointer) at `address`."""

    def codegen(context, builder, signature, args):
        return builder.load(_pointer(builder, args[0], _I64))

    return types.int64(types.int64), codegen


@intrinsic
def load_i4(typingctx, address):
    """The int32 at `address`."""

    def codegen(context, builder, signature, args):
        return builder.load(_pointer(builder, args[0], ir.IntType(32)))

    return types.int32(types.int64), codegen


@intrinsic
def as_f8_pointer(typingctx, address):
    """`address` as a pointer that `numba.carray` turns into an array."""

    def codegen(context, builder, signature, args):
        return _pointer(builder, args[0], _F64)

    return types.CPointer(types.float64)(types.int64), codegen


@intrinsic
def as_void_pointer(typingctx, address):
    """`address` as a pointer that `numba.carray` turns into an array of a given type."""

    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], ir.IntType(8).as_pointer())

    return types.voidptr(types.int64), codegen
