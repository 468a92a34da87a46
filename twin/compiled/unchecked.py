"""Unchecked: what compiled code does with addresses that numba does not look after.

Who calls these keeps what they point to alive, as long as the compiled code runs.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_null_value
from numba.extending import intrinsic
from numba.np.arrayobj import make_array


@intrinsic
def borrowed(typingctx, array):  # type: ignore[no-untyped-def]
    """The array without a count of who holds it.

    Each slice of an array that goes to a function adds one to its count and takes it off again,
    both atomic: for a small function that is a third of its time, and threads wait for each other.
    """

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        view = make_array(signature.args[0])(context, builder, args[0])
        view.meminfo = get_null_value(view.meminfo.type)
        view.parent = get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), codegen


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
