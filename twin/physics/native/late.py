"""Late compilation: C functions that callbacks call by address, compiled at their first use.

The address is 0 until then, and again after a type is registered that the function may call.

The code that needs such a function may run inside MuJoCo's step, where a Python exception cannot
pass. If compiling fails there, no address is set and the caller gets not-a-number:

- A thread that steps from Python gets MuJoCo's error, a `FatalError`; its next step tries again.
- A thread of MuJoCo's own cannot be unwound: it logs the error, and the run fails. The next
  `install` tries again.
- Ctrl-C waits until the function is compiled, and acts when the step returns.

Two functions that most flights do not need are late. The sampler of currents holds the kernels of
all types of current, an eighth of the code of a first flight. The other lays the sea floor's plane
under the hull, for MuJoCo's contacts and the altitude.
"""

from __future__ import annotations

import ctypes
import logging
import math
import sys
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import carray, types
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import intrinsic

from twin.compiled import cfunc, generation, inline, jit
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import (
    array,
    block_start,
    field,
    header_address,
    header_at,
    layout_table,
    load_i8,
    mju_error,
    state_of,
    table_of,
)
from twin.water.current.sampler import sample_gradient
from twin.water.floor.lookup import floor_depth

CURRENT, FLOOR = range(2)
"""Slots of the two late functions in TABLE."""
FLOW = 15
"""Count of the numbers that `sample_gradient` returns."""
SLOTS = 2
WORDS = 2
"""Words of each slot in TABLE."""
REFUSED = 1
"""Value in place of an address: compiling failed and is not tried again before `renew`."""
TABLE = (ctypes.c_int64 * (WORDS * SLOTS + 1))()
"""Addresses, by slot, of the function and of its compiler hook; last, that of Python's Ctrl-C."""
TABLE[WORDS * SLOTS] = ctypes.cast(ctypes.pythonapi.PyErr_SetInterrupt, ctypes.c_void_p).value or 0
INTERRUPTED = -1
"""Answer in place of an error text's address: Ctrl-C came during compilation."""
late_table = types.ExternalFunction("glider_twin_late", types.int64())
"""Address of TABLE."""
_log = logging.getLogger(__name__)


class Late:
    """A function that is compiled late: its slot, its numba signature and its Python code."""

    def __init__(self, slot: int, name: str, signature: Any, function: Callable[..., None]):
        self.slot, self.name = slot, name
        self._signature, self._function = signature, function
        self._made = -1
        self._kept: list[Any] = []
        """Functions of every generation, kept because other threads may be running an older one."""
        self._texts: list[Any] = []
        """Texts of errors, kept because MuJoCo reads them after Python code has returned."""
        self._hook = ctypes.CFUNCTYPE(None, ctypes.POINTER(ctypes.c_int64))(self._prepare_in_step)
        TABLE[WORDS * slot + 1] = ctypes.cast(self._hook, ctypes.c_void_p).value or 0

    @property
    def address(self) -> int:
        """Address of the function; 0 before it is compiled; REFUSED after a failure."""
        return int(TABLE[WORDS * self.slot])

    @address.setter
    def address(self, value: int) -> None:
        TABLE[WORDS * self.slot] = value

    def prepare(self) -> None:
        """Compile the function unless it is up to date with the registered types."""
        # numba's own lock: with a second lock, two threads that compile could deadlock
        with global_compiler_lock:
            while self.address in (0, REFUSED) or self._made != generation():
                now = generation()
                self._kept.append(self._compile())
                self.address, self._made = self._kept[-1].address, now

    def renew(self) -> None:
        """Mark the function for compilation at its next use, if it is outdated or had failed."""
        with global_compiler_lock:
            if self.address == REFUSED or self._made != generation():
                self.address = 0

    def _compile(self) -> Any:
        return cfunc(self._signature)(self._function)

    def _prepare_in_step(self, answer: Any) -> None:
        """Compile the function inside MuJoCo's step; answer is a text's address or INTERRUPTED.

        Nobody could catch an exception here: the answer then stays 0, and no address is set.
        """
        interrupted = True
        while interrupted:
            try:
                self.prepare()
                interrupted = False
            except KeyboardInterrupt:
                answer[0] = INTERRUPTED
            except BaseException as error:
                self._refuse(answer, error)
                return

    def _refuse(self, answer: Any, error: BaseException) -> None:
        text = (
            f"glider-twin: {self.name} could not be compiled inside the step: "
            f"{type(error).__name__}: {error}"
        )
        # numba's errors fill pages; MuJoCo truncates at a thousand characters
        text = text if len(text) < 900 else f"{text[:900]} ..."
        if sys._getframe(1).f_back is not None:  # Python called the step
            self._texts[:] = [*self._texts[-9:], ctypes.create_string_buffer(text.encode())]
            answer[0] = ctypes.addressof(self._texts[-1])
        else:
            self.address = REFUSED
            _log.error(text, exc_info=error)


@intrinsic
def _call_hook(typingctx, hook):
    """Call the hook at an address with a word for its answer; return the answer."""

    def codegen(context, builder, signature, args):
        word = ir.IntType(64)
        with builder.goto_entry_block():
            answer = builder.alloca(word)
        builder.store(ir.Constant(word, 0), answer)
        kind = ir.FunctionType(ir.VoidType(), [word.as_pointer()])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), [answer])
        return builder.load(answer)

    return types.int64(types.int64), codegen


@intrinsic
def _call_address(typingctx, address):
    """Call the function at an address, which takes no arguments."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(ir.VoidType(), [])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), [])
        return context.get_dummy_value()

    return types.void(types.int64), codegen


@jit
def late_address(slot):
    """Address of the function of a slot, compiled now if necessary; 0 if that fails.

    Raises MuJoCo's error if that fails and Python called the step.
    """
    place = late_table() + 8 * WORDS * slot
    address = load_i8(place)
    if address == 0:
        answer = _call_hook(load_i8(place + 8))
        if answer == INTERRUPTED:
            _call_address(load_i8(late_table() + 8 * WORDS * SLOTS))
        elif answer != 0:
            mju_error(answer)
        address = load_i8(place)
    if address == REFUSED:
        return 0
    return address


_DOUBLE, _WORD = ir.DoubleType(), ir.IntType(64)
_POINTER = types.CPointer(types.float64)


def sampled(program, size, time, north, east, down, out):
    """Write `sample_gradient` of a program into `out`, as a C function."""
    found, flow = sample_gradient(carray(program, size), time, north, east, down), carray(out, FLOW)
    for i in range(FLOW):
        flow[i] = found[i]


_SIGNATURE = types.void(_POINTER, types.int64, *(types.float64,) * 4, _POINTER)
SAMPLER = Late(CURRENT, "the sampler of currents", _SIGNATURE, sampled)
_UNKNOWN = (math.nan,) * FLOW
"""Result without a sampler: NaN makes the run fail, and still water would not."""


@intrinsic
def _call_sampler(typingctx, address, program, size, t, north, east, down):
    """Call the sampler at `address` with the program at another address; return its numbers."""
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
    """Current and gradient from the program in a model's block; NaN if compiling fails."""
    address = late_address(CURRENT)
    if address == 0:
        return _UNKNOWN
    return _call_sampler(address, program.ctypes.data, program.size, t, north, east, down)


def laid(model, data):
    """Call `lay_plane` for a model of ours, as a C function."""
    table = layout_table()
    address = header_address(table, model)
    head = header_at(address)
    floor = table_of(block_start(address, head), head, head.floor)
    position = array(field(table, data, at.D_XPOS) + 24 * int(head.hull_body), 3)
    lay_plane(head, floor, table, data, position, state_of(table, data))


LAYER = Late(FLOOR, "the sea floor", types.void(types.int64, types.int64), laid)


@intrinsic
def _call_layer(typingctx, address, model, data):
    """Call the function at an address with a model and its data."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(ir.VoidType(), [_WORD, _WORD])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@inline
def follow_floor(head, model, data, state):
    """Find the altitude of the CB and lay the plane under the hull; inf without a sea floor.

    Returns False, with the altitude NaN, if its code cannot be compiled; else True.
    """
    state.altitude = math.inf
    if head.floor["size"] > 0.0:
        address = late_address(FLOOR)
        if address == 0:
            state.altitude = math.nan
            return False
        _call_layer(address, model, data)
    return True


@jit
def lay_plane(head, floor, table, data, position, state):
    """Write position and attitude of the floor's plane under the hull, and the altitude."""
    north, east, arm = position[0], -position[1], 0.5 * head.length
    state.altitude = floor_depth(floor, north, east) + position[2]
    ahead, behind = floor_depth(floor, north + arm, east), floor_depth(floor, north - arm, east)
    right, left = floor_depth(floor, north, east + arm), floor_depth(floor, north, east - arm)
    # the floor's rise per metre along x (north) and y (west)
    along, across = (behind - ahead) / (2.0 * arm), (right - left) / (2.0 * arm)
    body = int(head.floor_body)
    place = array(field(table, data, at.D_MOCAP_POS) + 24 * body, 3)
    turn = array(field(table, data, at.D_MOCAP_QUAT) + 32 * body, 4)
    place[0], place[1] = position[0], position[1]
    place[2] = -0.25 * (ahead + behind + right + left)
    # the quaternion that turns z into the normal (-along, -across, 1)
    scale = 1.0 / math.sqrt(1.0 + along * along + across * across)
    w = 1.0 + scale
    norm = 1.0 / math.sqrt(w * w + (along * along + across * across) * scale * scale)
    turn[0], turn[1], turn[2] = w * norm, across * scale * norm, -along * scale * norm
    turn[3] = 0.0
