"""Silence for MuJoCo's own warnings while our code watches a run."""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterator

import mujoco

_SAY_NOTHING = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(lambda message: None)


@contextlib.contextmanager
def quiet_mujoco() -> Iterator[None]:
    """Keep MuJoCo from printing and logging warnings: an unstable run is reported as an error."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_SAY_NOTHING)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
