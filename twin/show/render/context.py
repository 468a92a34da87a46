"""OpenGL contexts without a screen, by EGL or else by OSMesa; and the check for a screen.

EGL draws on a GPU or, with Mesa, on the CPU; OSMesa draws on the CPU only. The working backend is
found before PyOpenGL is imported, because PyOpenGL then keeps one backend for the whole process. If
the environment variable MUJOCO_GL is `egl` or `osmesa`, only that backend is tried.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import os
import sys
import warnings
from collections.abc import Iterator
from typing import Any

from twin.errors import TwinError
from twin.extras import preload_triton

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")  # environment variables that name a screen on Linux
WAY_OUT = (
    "`twin view --web` shows it in a browser, `twin render STORE --html dive.html` writes such a "
    "page, `twin render` draws pictures and videos; `xvfb-run -a` (Debian package xvfb) gives the "
    "command a virtual screen"
)
BACKENDS = {"egl": "libegl1 libopengl0 libgl1-mesa-dri", "osmesa": "libosmesa6"}
"""Debian packages of each backend, the preferred backend first."""
_EGL_PLATFORM_DEVICE = 0x313F  # EGL_PLATFORM_DEVICE_EXT, of EGL_EXT_platform_device
_MOST_DEVICES = 16
_drawing: int | None = None
"""Identifier of the process that drew first: this process or the one that it was forked from"""


class NoScreen(TwinError):
    """No screen is available for a window."""


def require_screen() -> None:
    """Check that there is a screen, by opening and closing a hidden window.

    Raises:
      NoScreen: there is no screen, or it cannot show OpenGL; the message says what to do.
    """
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in DISPLAYS):
        raise NoScreen(f"no screen ({' and '.join(DISPLAYS)} are not set): {WAY_OUT}")
    preload_triton()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW also warns of the errors that are raised below
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


class NoOpenGL(TwinError):
    """This machine cannot draw: a library is missing, or drawing was switched off."""


class ForkedDrawing(TwinError):
    """Drawing in a process that was forked from one that had drawn: it would wait for ever."""


def available_backend() -> str | None:
    """Name of the first working backend, `egl` or `osmesa`, or None; imports no OpenGL."""
    wanted = os.environ.get("MUJOCO_GL", "").strip().lower()
    if wanted in ("disable", "disabled", "off", "false", "0"):
        return None
    preload_triton()
    # PyOpenGL, once imported, cannot change its platform any more.
    settled = os.environ.get("PYOPENGL_PLATFORM", "").lower() if "OpenGL" in sys.modules else ""
    chosen = {wanted, settled} & BACKENDS.keys()
    for name, works in (("egl", _egl_works), ("osmesa", _osmesa_works)):
        if chosen <= {name} and works():
            return name
    return None


def claim_drawing() -> None:
    """Record that this process draws; OpenGL's threads and locks do not survive a fork.

    Raises:
      ForkedDrawing: this process was forked from a process that had drawn.
    """
    global _drawing
    if _drawing not in (None, os.getpid()):
        raise ForkedDrawing(
            f"this process was forked from process {_drawing}, which had drawn before, so drawing "
            "here would wait for ever: start processes with "
            "multiprocessing.get_context('spawn'), or AsyncVectorEnv(..., context='spawn')"
        )
    _drawing = os.getpid()


def new_context(width: int, height: int) -> Any:
    """Make MuJoCo's offscreen context with the preferred backend; it is released at exit.

    Args:
      width, height: [pixel] size of the largest picture, which OSMesa needs.

    Raises:
      NoOpenGL: no backend works; the message names the Debian packages to install.
      ForkedDrawing: this process was forked from one that had drawn.
    """
    claim_drawing()
    switch = os.environ.get("MUJOCO_GL", "")
    said = f"MUJOCO_GL={switch} is set; " if switch else ""
    advice = (
        f"no OpenGL without a screen: {said}on Debian, apt-get install {BACKENDS['egl']} (EGL), or "
        f"{BACKENDS['osmesa']} (OSMesa)"
    )
    backend = available_backend()
    if backend is None:
        raise NoOpenGL(advice)
    os.environ["MUJOCO_GL"] = backend  # MuJoCo's C side asks it where to find OpenGL's functions
    try:
        context: Any
        if backend == "egl":
            from mujoco.egl import GLContext as EglContext

            context = EglContext(width, height)
        else:
            from mujoco.osmesa import GLContext as OsmesaContext

            context = OsmesaContext(width, height)
        context.make_current()
    except Exception as error:
        # PyOpenGL and the drivers raise many types of error; all mean that there is no context.
        reason = f"{backend} is installed but gives no context ({error})"
        raise NoOpenGL(f"{reason}. {advice}") from error
    # MuJoCo ends EGL at exit; functions registered later run earlier, so contexts go first.
    atexit.register(context.free)
    return context


@contextlib.contextmanager
def keep_current() -> Iterator[None]:
    """Restore this thread's current EGL context at exit.

    dm_control caches which of its contexts is current, and does not ask OpenGL.
    """
    egl = sys.modules.get("OpenGL.EGL")
    before = egl and (
        egl.eglGetCurrentDisplay(),
        egl.eglGetCurrentSurface(egl.EGL_DRAW),
        egl.eglGetCurrentSurface(egl.EGL_READ),
        egl.eglGetCurrentContext(),
    )
    try:
        yield
    finally:
        if egl and before and before[-1]:
            with contextlib.suppress(egl.EGLError):  # the context may have been freed since
                egl.eglMakeCurrent(*before)


def release(context: Any) -> None:
    """Free a context from `new_context` now."""
    context.free()
    atexit.unregister(context.free)


def _loaded(*files: str) -> ctypes.CDLL | None:
    """Load the first of these shared libraries that is available; None without any."""
    for file in files:
        with contextlib.suppress(OSError):
            return ctypes.CDLL(file)
    return None


def _osmesa_works() -> bool:
    return _loaded("libOSMesa.so.8", "libOSMesa.so.6") is not None


def _egl_works() -> bool:
    """Return True if an EGL device can be initialised: the library alone cannot draw."""
    library = _loaded("libEGL.so.1")
    if library is None:
        return False
    library.eglGetProcAddress.restype = ctypes.c_void_p
    query = library.eglGetProcAddress(b"eglQueryDevicesEXT")
    display = library.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not query or not display:
        return False
    pointer, number = ctypes.c_void_p, ctypes.c_uint
    places = (ctypes.POINTER(pointer), ctypes.POINTER(ctypes.c_int))
    query_devices = ctypes.CFUNCTYPE(number, ctypes.c_int, *places)(query)
    get_display = ctypes.CFUNCTYPE(pointer, number, pointer, pointer)(display)
    library.eglInitialize.argtypes = [pointer] * 3
    devices = (pointer * _MOST_DEVICES)()
    count = ctypes.c_int()
    if not query_devices(_MOST_DEVICES, devices, ctypes.byref(count)):
        return False
    handles = (get_display(_EGL_PLATFORM_DEVICE, one, None) for one in devices[: count.value])
    return any(handle and library.eglInitialize(handle, None, None) for handle in handles)
