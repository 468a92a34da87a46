"""Preload: triton's library before Mesa's, so that the two do not mix.

Debian's Mesa draws on the CPU with a shared LLVM and makes its symbols global. Triton, which comes
with PyTorch's CUDA build, carries an LLVM of its own. Triton 3.7 and later, when loaded after Mesa,
bind to Mesa's LLVM, and the first constructor in `torch.optim` is then a segmentation fault. So
triton's library is loaded before anything opens an OpenGL context. Where triton is not installed,
nothing is loaded.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib.util
import os
import sys
from pathlib import Path

_LIBRARY = Path("_C") / "libtriton.so"
_MESA_LLVM = "libLLVM"
_LOADED = Path("/proc/self/maps")
"""Where Linux lists the libraries of this process"""


@functools.cache
def preload_triton() -> None:
    """Load triton's library, once; call it before an OpenGL context is made and before training."""
    if not sys.platform.startswith("linux") or "triton" in sys.modules:
        return
    spec = importlib.util.find_spec("triton")  # finds it, does not import it
    for folder in (spec and spec.submodule_search_locations) or ():
        library = Path(folder) / _LIBRARY
        if library.is_file():
            # A library that does not load is torch's business, not that of somebody who draws.
            with contextlib.suppress(OSError):
                ctypes.CDLL(str(library), mode=_mode())
            return


def _mode() -> int:
    """Ordinary, or with triton's own symbols first if somebody else has already opened OpenGL."""
    try:
        too_late = _MESA_LLVM in _LOADED.read_text(errors="replace")
    except OSError:
        too_late = False
    # Not always: with its own symbols first it would miss an allocator that the user preloads.
    return os.RTLD_NOW | os.RTLD_LOCAL | (os.RTLD_DEEPBIND if too_late else 0)
