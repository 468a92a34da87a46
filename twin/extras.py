"""Extras: checks of optional packages, their installation commands, and the order of loading.

`require_factory` detects factory_boy, whose package is called `factory` too: pip lets one project
silently replace files of the other.

`preload_triton` loads Triton before Mesa. Debian's Mesa draws on the CPU with a shared LLVM and
makes its symbols global. Triton, which comes with PyTorch's CUDA build, carries its own LLVM. If
Triton 3.7 or later is loaded after Mesa, it binds to Mesa's LLVM, and the first constructor in
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
"""File in which Linux lists the libraries of this process"""
AGAIN = "pip install --force-reinstall --no-deps glider-twin"


@functools.cache
def preload_triton() -> None:
    """Load triton's library once; call this before making an OpenGL context and before training."""
    if not sys.platform.startswith("linux") or "triton" in sys.modules:
        return
    spec = importlib.util.find_spec("triton")  # finds it, does not import it
    for folder in (spec and spec.submodule_search_locations) or ():
        library = Path(folder) / "_C" / "libtriton.so"
        if library.is_file():
            mode = os.RTLD_NOW | os.RTLD_LOCAL
            # If OpenGL is open already, triton must prefer its own symbols. Not otherwise: it
            # would then bypass an allocator that the user preloads.
            with contextlib.suppress(OSError):
                if "libLLVM" in _LOADED.read_text(errors="replace"):
                    mode |= os.RTLD_DEEPBIND
            # A library that does not load concerns torch, not a user who only draws.
            with contextlib.suppress(OSError):
                ctypes.CDLL(str(library), mode=mode)
            return


def require(package: str, *, extra: str, purpose: str, load: bool = True, then: str = "") -> None:
    """Check that the packages of an extra are installed.

    Args:
      package: name of the package that will be imported.
      extra: the extra of this project that installs the package, or `plugins/NAME`.
      purpose: start of the message: the task that needs the package.
      load: import the package; if False, only look for it, which is quick.
      then: text that follows the installation command in the message.

    Raises:
      InputError: the package cannot be imported; the message names the installation command.
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
      InputError: the package belongs to another distribution, or has lost its `__init__.py`.
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
    """Check that the packages that `learn` needs are there: `factory` and PyTorch.

    Raises:
      InputError: a package is missing; the message says what to do.
    """
    require_factory()
    require("torch", extra="learn", purpose="learn", load=False)


def started_as(program: str) -> bool:
    """Return True if this process runs `program` or `python -m`, whose errors have no traceback."""
    return Path(sys.argv[0] if sys.argv else "").stem in (program, "-m")
