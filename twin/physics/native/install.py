"""Install: the compiled callbacks, put into MuJoCo and taken out again."""

from __future__ import annotations

import ctypes
import functools
import threading
from typing import Any, cast

import llvmlite.binding as llvm
import mujoco
from numba import types

from twin.compiled import Compiled, cfunc, generation
from twin.errors import TwinError
from twin.physics.native import late, plant
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import MISMATCH

_VOID = types.void(types.int64, types.int64)
_PROTOTYPES = {
    "passive": ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p),
    "control": ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p),
    "act_dyn": ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int),
}
_lock = threading.RLock()
_installed: dict[str, Any] = {}
_addresses: dict[str, int] = {}
_stopped: list[int] = []
"""Address of the clock that `stop_timers` has removed."""


@functools.cache
def _compile(_: int) -> dict[str, Any]:
    """Compile the C functions of one `generation`; older ones stay for threads that run them."""
    at.publish()
    at.publish_text("glider_twin_mismatch", MISMATCH)
    at.publish_text("glider_twin_late", late.TABLE)
    llvm.load_library_permanently(str(at.library_path()))

    # compiled directly as callbacks: callbacks that only called these would be compiled twice
    water, control, actuate = (
        cast(Compiled, function).py_func for function in (plant.water, plant.control, plant.actuate)
    )
    return {
        "passive": cfunc(_VOID)(water),
        "control": cfunc(_VOID)(control),
        "act_dyn": cfunc(types.float64(types.int64, types.int64, types.int32))(actuate),
    }


def install(*, current: bool = False, floor: bool = False) -> None:
    """Install the callbacks in this process; a repeated call changes nothing.

    Code for a `current` or a `floor` is compiled now if requested, otherwise in the first step that
    needs it (see `twin.physics.native.late`).

    After a new type of current, part or hull law is registered, the callbacks are compiled again.

    MuJoCo's timers (`data.timer`) read the clock of Python's bindings some twenty times a step,
    which takes a quarter of a glider's bare step. That clock is removed. A clock given with
    `mujoco.set_mjcb_time` stays, and so do the timers.

    Raises:
      LayoutError: MuJoCo's structs are not where the callbacks would look.
      TwinError: another library's callback is already installed.
    """
    with _lock:
        compiled = _compile(generation())
        for one, wanted in ((late.SAMPLER, current), (late.LAYER, floor)):
            one.renew()
            if wanted:
                one.prepare()
        for name, function in compiled.items():
            present = getattr(mujoco, f"get_mjcb_{name}")()
            ours = _installed.get(name)
            if present is not None and present is not ours:
                raise TwinError(
                    f"mjcb_{name} is already taken by {present!r}; MuJoCo has one per process: "
                    f"clear it with mujoco.set_mjcb_{name}(None) before loading a vehicle"
                )
            if _addresses.get(name) != function.address:
                ours = _PROTOTYPES[name](function.address)
                _installed[name], _addresses[name] = ours, function.address
            if present is not ours:
                getattr(mujoco, f"set_mjcb_{name}")(ours)
        stop_timers()


def uninstall() -> None:
    """Remove the callbacks and restore the timers; vehicles in this process then move in vacuum."""
    with _lock:
        for name, ours in _installed.items():
            if getattr(mujoco, f"get_mjcb_{name}")() is ours:
                getattr(mujoco, f"set_mjcb_{name}")(None)
        start_timers()


def stop_timers() -> None:
    """Remove the clock of MuJoCo's timers if Python's bindings have set it."""
    clock = _clock()
    if clock.value is not None and mujoco.get_mjcb_time() is None:
        _stopped[:], clock.value = [clock.value], None


def start_timers() -> None:
    """Restore the clock that `stop_timers` has removed."""
    clock = _clock()
    if _stopped and clock.value is None:
        clock.value = _stopped.pop()


@functools.cache
def _clock() -> ctypes.c_void_p:
    """Pointer in MuJoCo to the clock of its timers; a null pointer stops them."""
    return ctypes.c_void_p.in_dll(ctypes.CDLL(str(at.library_path())), "mjcb_time")
