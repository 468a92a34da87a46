"""Extras: optional packages, the command that installs one, and what must be loaded first.

A package `factory` of another project, factory_boy's, is named too: pip lets the one replace files
of the other without a word.

Triton is loaded before Mesa. Debian's Mesa draws on the CPU with a shared LLVM and makes its
symbols global. Triton, which comes with PyTorch's CUDA build, carries an LLVM of its own. Triton
3.7 and later, when loaded after Mesa, bind to Mesa's LLVM, and the first constructor in
`torch.optim` is then a segmentation fault. Where triton is not installed, nothing is loaded.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib.util
import os
import sys
from importlib import metadata
from pathlib import Path

from twin.errors import InputError
from twin.plugins import installation

_LOADED = Path("/proc/self/maps")
"""Where Linux lists the libraries of this process"""
AGAIN = "pip install --force-reinstall --no-deps glider-twin"


@functools.cache
def preload_triton() -> None:
    """Load triton's library, once; call it before an OpenGL context is made and before training."""
    if not sys.platform.startswith("linux") or "triton" in sys.modules:
        return
    spec = importlib.util.find_spec("triton")  # finds it, does not import it
    for folder in (spec and spec.submodule_search_locations) or ():
        library = Path(folder) / "_C" / "libtriton.so"
        if library.is_file():
            mode = os.RTLD_NOW | os.RTLD_LOCAL
            # With its own symbols first if somebody else has already opened OpenGL; not always:
            # it would miss an allocator that the user preloads.
            with contextlib.suppress(OSError):
                if "libLLVM" in _LOADED.read_text(errors="replace"):
                    mode |= os.RTLD_DEEPBIND
            # A library that does not load is torch's business, not that of somebody who draws.
            with contextlib.suppress(OSError):
                ctypes.CDLL(str(library), mode=mode)
            return


def require(package: str, *, extra: str, purpose: str, load: bool = True, then: str = "") -> None:
    """Check that the packages of an extra are installed.

    Args:
      package: what will be imported.
      extra: the extra of this project that brings it, or `plugins/NAME`.
      purpose: what it is for, the start of the message.
      load: import it; without, only look for it, which is quick.
      then: what the command that installs it goes on with.

    Raises:
      InputError: it cannot be imported; the message says which command installs it.
    """
    try:
        if load:
            importlib.import_module(package)
        elif importlib.util.find_spec(package) is None:
            raise ImportError("it is not installed")
    except ImportError as error:
        raise InputError(
            f"{purpose} needs the package {package}, which cannot be imported ({error}): "
            f"{installation(extra)}{then}"
        ) from error


def require_factory() -> None:
    """Check that the package `factory` is this project's.

    Raises:
      InputError: it is another distribution's, or lost its first file to one.
    """
    spec = importlib.util.find_spec("factory")
    origin = Path((spec and spec.origin) or "")
    if origin.is_file() and "from twin.lazy import" in origin.read_text(errors="replace"):
        return
    if not origin.is_file():
        raise InputError(
            "the package factory has no __init__.py, as after pip uninstall factory_boy, which has "
            f"a package of that name too: {AGAIN}"
        )
    others = set(metadata.packages_distributions().get("factory", ())) - {"glider-twin"}
    if others:
        owner = " and ".join(sorted(others))
        raise InputError(
            f"{origin} belongs to {owner}, which has a package factory as glider-twin has: pip "
            f"uninstall {owner}, then {AGAIN}; or give each an environment of its own"
        )
    raise InputError(
        f"{origin} is not glider-twin's factory and is found before it: rename that package, or "
        "take its folder off PYTHONPATH"
    )


def require_learning() -> None:
    """Check what `learn` stands on: the package `factory` and PyTorch.

    Raises:
      InputError: one of them is missing; the message says what to do.
    """
    require_factory()
    require("torch", extra="learn", purpose="learn", load=False)


def started_as(program: str) -> bool:
    """Whether this process runs `program` or `python -m`, which report errors without traceback."""
    return Path(sys.argv[0] if sys.argv else "").stem in (program, "-m")
