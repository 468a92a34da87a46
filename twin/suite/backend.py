"""Backend: how dm_control draws on a machine without a screen."""

from __future__ import annotations

import os
import sys

from twin.extras import preload_triton

_VARIABLE = "MUJOCO_GL"
_SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")


def choose_backend() -> None:
    """Name a backend in MUJOCO_GL where there is no screen and nobody has named one.

    dm_control tries GLFW first while it is imported, which warns without a screen. With a screen,
    or with MUJOCO_GL set, the choice stays dm_control's and the user's.
    """
    preload_triton()  # dm_control opens OpenGL while it is imported
    named = os.environ.get(_VARIABLE)
    if named or not sys.platform.startswith("linux"):
        return
    if any(os.environ.get(screen) for screen in _SCREENS):
        return
    from twin.show.render.context import available_backend

    os.environ[_VARIABLE] = available_backend() or "disable"
