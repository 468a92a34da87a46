"""Screen: whether a window can be opened here, and what to do where it cannot."""

from __future__ import annotations

import os
import sys
import warnings

from twin.errors import TwinError
from twin.extras import preload_triton

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Environment variables that name a screen on Linux"""
WAY_OUT = (
    "`twin view --web` shows it in a browser, `twin render STORE --html dive.html` writes such a "
    "page, `twin render` draws pictures and videos; `xvfb-run -a` (Debian package xvfb) gives the "
    "command a virtual screen"
)


class NoScreen(TwinError):
    """A window is wanted and there is no screen for it."""


def require_screen() -> None:
    """Open and close a hidden window.

    Raises:
      NoScreen: there is no screen, or it cannot show OpenGL; the message says what to do.
    """
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in DISPLAYS):
        raise NoScreen(f"no screen ({' and '.join(DISPLAYS)} are not set): {WAY_OUT}")
    preload_triton()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW reports as warnings what is raised below
        try:
            import glfw
        except ImportError as error:
            raise NoScreen(f"no window library ({error}): {WAY_OUT}") from error
        named = next((os.environ[name] for name in DISPLAYS if os.environ.get(name)), "here")
        if not glfw.init():
            raise NoScreen(f"the screen {named} cannot be opened: {WAY_OUT}")
        glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
        window = glfw.create_window(64, 64, "probe", None, None)
        glfw.default_window_hints()
        if not window:
            raise NoScreen(f"the screen {named} shows no OpenGL: {WAY_OUT}")
        glfw.destroy_window(window)
