"""Unchecked: what compiled code does with addresses that numba does not look after.

Who calls these keeps what they point to alive, as long as the compiled code runs.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def call_rate(typingctx, function, block, g):  # type: ignore[no-untyped-def]
    """Call the structure's function at an address with the block at another one."""

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
