"""Folder: where compiled code is kept, in a place that no other user can write.

Compiled code is run, so whoever can write it, or rename a folder above it, can run code as this
user. Every level up to the root is checked.
"""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import stat
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

KEPT_DAYS = 30.0
"""[day] Versions that no process has used for longer are removed."""

TOUCH_DAYS = 1.0
"""[day] A version in use is marked as used again after this time."""

_DAY = 86_400.0
_PACKAGE = Path(__file__).resolve().parent.parent


@functools.cache
def cache_root() -> Path | None:
    """The first trusted folder of `candidates`, created; None, with a warning, when none is.

    A folder that cannot be written is passed over like one that cannot be trusted.
    """
    reasons = []
    for candidate in candidates():
        folder = candidate.resolve()  # once: a link that is turned elsewhere later changes nothing
        reason = _prepare(folder)
        if reason is None:
            return folder
        reasons.append(reason)
    warnings.warn(
        "compiled code is not kept and every start compiles again: "
        + "; ".join(reasons)
        + "; set XDG_CACHE_HOME to a folder that only you can write",
        RuntimeWarning,
        stacklevel=2,
    )
    return None


def candidates() -> Iterator[Path]:
    """Beside the package where it belongs to this user, the user's cache, a private temporary one.

    The last has the user's number in its name; whoever made it first, `refusal` decides.
    """
    if not hasattr(os, "getuid") or _PACKAGE.stat().st_uid == os.getuid():
        yield _PACKAGE / "__pycache__" / "compiled"
    with contextlib.suppress(RuntimeError):  # no home folder is known
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "glider-twin"
    user = os.getuid() if hasattr(os, "getuid") else "user"
    yield Path(tempfile.gettempdir()) / f"glider-twin-{user}"


def refusal(folder: Path) -> str | None:
    """Why another user could change what is in `folder`, None when none could.

    `folder` is a resolved path, without links. It belongs to this user, and only this user writes
    it. Each folder above belongs to this user or root, and where others may write it, it is sticky:
    they cannot rename there.
    """
    if not hasattr(os, "getuid"):
        return None
    user = os.getuid()
    for level in (folder, *folder.parents):
        state = level.stat()
        if state.st_uid != user and (level == folder or state.st_uid != 0):
            return f"{level} belongs to user {state.st_uid}"
        shared = state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if shared and (level == folder or not state.st_mode & stat.S_ISVTX):
            return f"{level} can be written by others"
    return None


def version_folder(root: Path, name: str) -> Path:
    """The folder of one version, `root/name`, created and marked as used.

    Creating one removes the versions beside it that no process has used for `KEPT_DAYS`: a process
    marks what it loads, so nothing that may still be read goes.
    """
    folder = root / name
    try:
        used = folder.stat().st_mtime
    except FileNotFoundError:
        folder.mkdir(mode=0o700, exist_ok=True)
        _remove_unused(root)
        return folder
    if time.time() - used > TOUCH_DAYS * _DAY:
        with contextlib.suppress(OSError):
            os.utime(folder)
    return folder


def _remove_unused(root: Path) -> None:
    for other in root.iterdir():
        with contextlib.suppress(OSError):
            if time.time() - other.lstat().st_mtime > KEPT_DAYS * _DAY:
                shutil.rmtree(other, ignore_errors=True)


def _prepare(folder: Path) -> str | None:
    """Create `folder` if need be; why it cannot be used, or None."""
    try:
        for level in reversed(folder.parents):
            level.mkdir(exist_ok=True, mode=0o755)
        folder.mkdir(exist_ok=True, mode=0o700)
        reason = refusal(folder)
    except OSError as error:
        return f"{folder}: {error.strerror or error}"
    if reason is None and not os.access(folder, os.W_OK):
        return f"{folder} cannot be written"
    return reason
