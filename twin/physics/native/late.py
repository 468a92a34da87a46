"""Late: C functions that the callbacks call by address, compiled when one is first needed.

The address is 0 until then, and again after a kind was registered that the function may call.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from twin.compiled import cfunc, generation, jit
from twin.physics.native.access import load_i8

SLOTS = 2
TABLE = (ctypes.c_int64 * (2 * SLOTS))()
"""Of each slot: the function's address, and that of what compiles it"""

late_table = types.ExternalFunction("glider_twin_late", types.int64())
"""Address of TABLE"""


class Late:
    """One such function: its slot, numba's signature of it, and the Python of it."""

    def __init__(self, slot: int, signature: Any, function: Callable[..., None]):
        self.slot = slot
        self._signature, self._function = signature, function
        self._made = -1
        self._kept: list[Any] = []
        """Those of every generation: other threads may be running an older one"""
        self._hook = ctypes.CFUNCTYPE(None)(self.prepare)
        TABLE[2 * slot + 1] = ctypes.cast(self._hook, ctypes.c_void_p).value or 0

    def prepare(self) -> None:
        """Compile it, unless it is that of today's kinds."""
        if TABLE[2 * self.slot] == 0 or self._made != generation():
            now = generation()
            self._kept.append(cfunc(self._signature)(self._function))
            TABLE[2 * self.slot], self._made = self._kept[-1].address, now

    def renew(self) -> None:
        """Have it compiled again, when it is needed, if a kind was registered since."""
        if self._made != generation():
            TABLE[2 * self.slot] = 0


@intrinsic
def _call(typingctx, address):
    """Call the function without arguments at an address."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(ir.VoidType(), [])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), [])
        return context.get_dummy_value()

    return types.void(types.int64), codegen


@jit
def late_address(slot):
    """Address of the function of a slot, which is compiled now if it is not yet."""
    place = late_table() + 16 * slot
    address = load_i8(place)
    if address == 0:
        _call(load_i8(place + 8))
        address = load_i8(place)
    return address
