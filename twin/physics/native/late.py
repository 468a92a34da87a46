"""Late: C functions that the callbacks call by address, compiled when one is first needed.

The address is 0 until then, and again after a kind was registered that the function may call.

The code that needs one may be inside MuJoCo's step, where a Python exception has nowhere to go. If
compiling fails there, the address stays no function's and the caller gets not-a-number:

- A thread that steps from Python gets MuJoCo's error, a `FatalError`; its next step tries again.
- A thread of MuJoCo's own, which nothing may unwind, logs the error, and the run fails. The next
  `install` has it tried again.
- Ctrl-C waits until it is compiled, and comes when the step returns.
"""

from __future__ import annotations

import ctypes
import logging
import sys
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import intrinsic

from twin.compiled import cfunc, generation, jit
from twin.physics.native.access import load_i8, mju_error

SLOTS = 2
WORDS = 2
"""Of a slot in TABLE"""
REFUSED = 1
"""In place of an address: it could not be compiled, and is not tried again before `renew`"""
TABLE = (ctypes.c_int64 * (WORDS * SLOTS + 1))()
"""Of each slot: the function's address, and that of what compiles it; then Python's Ctrl-C"""
TABLE[WORDS * SLOTS] = ctypes.cast(ctypes.pythonapi.PyErr_SetInterrupt, ctypes.c_void_p).value or 0
INTERRUPTED = -1
"""Instead of the address of an error's text"""

late_table = types.ExternalFunction("glider_twin_late", types.int64())
"""Address of TABLE"""

_log = logging.getLogger(__name__)


class Late:
    """One such function: its slot, numba's signature of it, and the Python of it."""

    def __init__(self, slot: int, name: str, signature: Any, function: Callable[..., None]):
        self.slot, self.name = slot, name
        self._signature, self._function = signature, function
        self._made = -1
        self._kept: list[Any] = []
        """Those of every generation: other threads may be running an older one"""
        self._texts: list[Any] = []
        """Of errors: MuJoCo reads one when Python has left it"""
        self._hook = ctypes.CFUNCTYPE(None, ctypes.POINTER(ctypes.c_int64))(self._asked)
        TABLE[WORDS * slot + 1] = ctypes.cast(self._hook, ctypes.c_void_p).value or 0

    @property
    def address(self) -> int:
        """Of the function, 0 before it is compiled; or REFUSED."""
        return int(TABLE[WORDS * self.slot])

    @address.setter
    def address(self, value: int) -> None:
        TABLE[WORDS * self.slot] = value

    def prepare(self) -> None:
        """Compile it, unless it is that of today's kinds."""
        # numba's own lock: with a second one, two threads that compile may wait for each other
        with global_compiler_lock:
            while self.address in (0, REFUSED) or self._made != generation():
                now = generation()
                self._kept.append(self._compile())
                self.address, self._made = self._kept[-1].address, now

    def renew(self) -> None:
        """Have it compiled again when it is needed, if a kind was registered since or it failed."""
        with global_compiler_lock:
            if self.address == REFUSED or self._made != generation():
                self.address = 0

    def _compile(self) -> Any:
        return cfunc(self._signature)(self._function)

    def _asked(self, answer: Any) -> None:
        """Prepare it inside MuJoCo's step, and answer with an error's text or INTERRUPTED.

        What this raises nobody would see: the answer stays 0, and the caller gets no address.
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
        # numba's errors are as long as pages; MuJoCo's end after a thousand characters
        text = text if len(text) < 900 else f"{text[:900]} ..."
        if sys._getframe(1).f_back is not None:  # Python called the step and catches its errors
            self._texts[:] = [*self._texts[-9:], ctypes.create_string_buffer(text.encode())]
            answer[0] = ctypes.addressof(self._texts[-1])
        else:
            self.address = REFUSED
            _log.error(text, exc_info=error)


@intrinsic
def _ask(typingctx, hook):
    """Call the function at an address with a place for its answer, and give the answer."""

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
def _call(typingctx, address):
    """Call the function without arguments at an address."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(ir.VoidType(), [])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), [])
        return context.get_dummy_value()

    return types.void(types.int64), codegen


@jit
def late_address(slot):
    """Address of the function of a slot, which is compiled now if it is not yet; 0: it cannot be.

    Raises MuJoCo's error when it cannot and the caller's caller is Python.
    """
    place = late_table() + 8 * WORDS * slot
    address = load_i8(place)
    if address == 0:
        answer = _ask(load_i8(place + 8))
        if answer == INTERRUPTED:
            _call(load_i8(late_table() + 8 * WORDS * SLOTS))
        elif answer != 0:
            mju_error(answer)
        address = load_i8(place)
    if address == REFUSED:
        return 0
    return address
