"""Where compiled native code is kept between processes.

Numba decides staleness by one file's time stamp, but the plant inlines functions of several
files. Its code is therefore cached in a folder named by the hash of all of them.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numba

_PACKAGE = Path(__file__).resolve().parent.parent
_SOURCES = ("native/*.py", "fossen/*.py", "current/*.py", "guidance.py", "density.py")


def source_hash() -> str:
    """Hash of every source file whose code ends up inside the native callbacks."""
    digest = hashlib.sha256(numba.__version__.encode())
    for pattern in _SOURCES:
        for path in sorted(_PACKAGE.glob(pattern)):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """A writable folder for this version of the sources; older versions beside it are removed."""
    user = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    name = f"jit-{source_hash()}"
    for base in (_PACKAGE / "__pycache__", user / "glider-twin", Path(tempfile.gettempdir())):
        folder = base / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            for old in base.glob("jit-*"):
                if old.name != name:
                    shutil.rmtree(old, ignore_errors=True)
            return folder
    raise OSError("no writable folder for compiled code: set XDG_CACHE_HOME to one")


@contextlib.contextmanager
def cached_by_content() -> Iterator[None]:
    """Functions compiled with `cache=True` inside this context use `cache_folder()`."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(cache_folder())
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before
