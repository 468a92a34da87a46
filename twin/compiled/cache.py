"""Where compiled native code is kept between processes.

Numba decides staleness by one file's time stamp, but the plant inlines functions of several
files. Its code is therefore cached in a folder named by the hash of all of them.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numba

from twin.compiled.private import private_folder

_PACKAGE = Path(__file__).resolve().parent.parent
_SOURCES = (
    "physics/native/*.py",
    "fossen/*.py",
    "water/current/*.py",
    "water/density.py",
    "mission/guidance.py",
)


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
    for base in (_PACKAGE / "__pycache__", user / "glider-twin", private_folder()):
        folder = base / name
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError:
            continue
        if os.access(folder, os.W_OK) and _is_mine(folder):
            for old in base.glob("jit-*"):
                if old.name != name:
                    shutil.rmtree(old, ignore_errors=True)
            return folder
    raise OSError("no writable folder for compiled code: set XDG_CACHE_HOME to one")


def _is_mine(folder: Path) -> bool:
    """Compiled code is run: only a folder that no other user can have filled will do."""
    return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()


@contextlib.contextmanager
def cached_by_content() -> Iterator[None]:
    """Functions compiled with `cache=True` inside this context use `cache_folder()`."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(cache_folder())
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before
