"""Flow: the current and its gradient at a point, by code that is compiled when one is first met.

Samplers hold the kernel of every kind of current, an eighth of what a first flight would compile,
and most flights have still water.
"""

from __future__ import annotations

import math

from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from twin.compiled import jit
from twin.physics.native.late import Late, late_address
from twin.water.current.sampler import sample_gradient

SLOT = 0
FLOW = 15
"""Numbers of `sample_gradient`"""

_DOUBLE, _WORD = ir.DoubleType(), ir.IntType(64)
_POINTER = types.CPointer(types.float64)


def sampled(program, size, time, north, east, down, out):
    """`sample_gradient` as a C function."""
    found, flow = sample_gradient(carray(program, size), time, north, east, down), carray(out, FLOW)
    for i in range(FLOW):
        flow[i] = found[i]


_SIGNATURE = types.void(_POINTER, types.int64, *(types.float64,) * 4, _POINTER)
SAMPLER = Late(SLOT, "the sampler of currents", _SIGNATURE, sampled)
_UNKNOWN = (math.nan,) * FLOW
"""Without a sampler: the run fails, which still water would hide"""


@intrinsic
def _sampled_at(typingctx, address, program, size, t, north, east, down):
    """What the sampler at `address` finds: `sample_gradient` of the program at an address."""
    result = types.UniTuple(types.float64, FLOW)
    point = (types.float64,) * 4

    def codegen(context, builder, signature, args):
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
def flow_at(program, t, north, east, down):
    """`sample_gradient` of a current's program in a model's block; NaN if it cannot be compiled."""
    address = late_address(SLOT)
    if address == 0:
        return _UNKNOWN
    return _sampled_at(address, program.ctypes.data, program.size, t, north, east, down)
