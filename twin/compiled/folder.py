"""Folder: the place of kept compiled code, which no other user can write.

Compiled code is executed, so a user who can write it, or rename a folder above it, can run code as
this user. Every level up to the root is checked; others may write a folder above only if it is
sticky.

Locator: gives numba the place of a function's code and the hash of its source.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import logging
import os
import shutil
import stat
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path
from types import FunctionType
from typing import Self, TypeVar

import numba
from numba.core import event
from numba.core.compiler_lock import global_compiler_lock

from twin.compiled import signatures

KEPT_DAYS = 30.0
"""[day] Age since the last use after which a version is removed."""
TOUCH_DAYS = 1.0
"""[day] Age after which a version in use is marked as used again."""
_DAY = 86_400.0
_PACKAGE = Path(__file__).resolve().parent.parent


@functools.cache
def cache_root() -> Path | None:
    """Return the first trusted folder of `candidates`, created.

    A folder that cannot be written is skipped like one that cannot be trusted. If none is left,
    returns None and warns with the reasons.
    """
    reasons = []
    for candidate in candidates():
        folder = candidate.resolve()  # resolved once, so that a link changed later has no effect
        reason = _prepare(folder)
        if reason is None:
            _seldom.first = next(folder.iterdir(), None) is None
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
    """Yield a folder in the package if this user owns it, then the user's cache folder."""
    if not hasattr(os, "getuid") or _PACKAGE.stat().st_uid == os.getuid():
        yield _PACKAGE / "__pycache__" / "compiled"
    with contextlib.suppress(RuntimeError):  # no home folder is known
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "glider-twin"


def refusal(folder: Path) -> str | None:
    """Reason why another user could change the content of `folder`; None when none could.

    `folder` is a resolved path, without links. It must belong to this user, and only this user may
    write it. Each folder above must belong to this user or root and, where others may write, be
    sticky, so that they cannot rename there.
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
    """Return the folder of one version, `root/name`, created and marked as used.

    A link, or a folder that others may have written while `root` was open to them, is removed
    first. Creating a folder removes versions beside it that no process has used for `KEPT_DAYS`.
    Processes mark the versions that they load, so no version in use is removed.
    """
    folder = root / name
    with contextlib.suppress(FileNotFoundError):
        state = folder.lstat()
        theirs = hasattr(os, "getuid") and state.st_uid != os.getuid()
        shared = hasattr(os, "getuid") and state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if not stat.S_ISDIR(state.st_mode):
            folder.unlink()
        elif theirs or shared:
            shutil.rmtree(folder)
        else:
            if time.time() - state.st_mtime > TOUCH_DAYS * _DAY:
                with contextlib.suppress(OSError):
                    os.utime(folder)
            return folder
    folder.mkdir(mode=0o700, exist_ok=True)
    for other in root.iterdir():
        with contextlib.suppress(OSError):
            if time.time() - other.lstat().st_mtime > KEPT_DAYS * _DAY:
                shutil.rmtree(other, ignore_errors=True)
    return folder


def _prepare(folder: Path) -> str | None:
    """Create `folder` if necessary; returns the reason why it cannot be used, or None."""
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


T = TypeVar("T")
_key: ContextVar[tuple[str, str, str]] = ContextVar("module, stamp, variant of what is decorated")


class ContentLocator:
    """One folder for each version of each module, so that versions never share an index.

    The class has the interface of numba's `numba.config.CACHE_LOCATOR_CLASSES`.
    """

    def __init__(self, function: FunctionType, file: str) -> None:
        module, self._stamp, self._variant = _key.get()
        root = cache_root()
        assert root is not None
        self._folder = version_folder(root, f"{module}-{self._stamp}")
        self._line = function.__code__.co_firstlineno
        self._py_file = file  # numba's warnings name this file

    def get_cache_path(self) -> str:
        """Path of the folder of this version."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Create the folder; raises OSError when it cannot be written."""
        self._folder.mkdir(mode=0o700, exist_ok=True)
        tempfile.TemporaryFile(dir=self._folder).close()

    def get_source_stamp(self) -> str:
        """Hash of the content."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """Line and variant of the function, which distinguish equal names in a module."""
        return f"{self._line}{self._variant}"

    @classmethod
    def from_function(cls, py_func: FunctionType, py_file: str) -> Self:
        """Make the locator; numba calls this."""
        return cls(py_func, py_file)


NOTE = "note.txt"
"""Name of the file beside the code of one version."""


def keep_note(module: str, stamp: str | None, text: str) -> None:
    """Store a text, which may be empty, beside the code of one version, for other processes.

    A folder that cannot be written keeps neither text nor code.
    """
    root = cache_root()
    if stamp is None or root is None:
        return
    with contextlib.suppress(OSError):
        folder = version_folder(root, f"{module}-{stamp}")
        with tempfile.NamedTemporaryFile("w", dir=folder, delete=False, encoding="utf-8") as file:
            file.write(text)
        Path(file.name).replace(folder / NOTE)  # atomic


def kept_note(module: str, stamp: str | None) -> str | None:
    """Read the text that `keep_note` stored beside the code of one version; None: there is none."""
    root = cache_root()
    if stamp is None or root is None:
        return None
    try:
        return (version_folder(root, f"{module}-{stamp}") / NOTE).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None


FIRST = (
    "compiling for this vehicle and processor, once: some 20 s (`twin compile` does it for"
    " every shipped vehicle)"
)
"""Message of the first compilation when no code is kept yet."""
_log = logging.getLogger(__name__)
OURS = "_made_by_twin_compiled"
"""Attribute of numba's objects that are made from our functions."""
SELDOM = 50_000
"""Number of new objects between garbage collections while numba compiles."""


class _CompileListener(event.Listener):
    """Listener for numba's compilations: makes garbage collection rare, which saves 7 % of the
    time.

    While a function of ours and its callees compile, `signatures` are remembered. The first
    compilation of all logs the message FIRST. numba calls the listener under its lock.
    """

    first = False
    """True: no code was kept when this process began, and FIRST has not been logged."""

    def __init__(self) -> None:
        self._depth, self._before = 0, gc.get_threshold()

    def on_start(self, event: event.Event | None = None) -> None:
        """Handle the start of a compilation; those of its callees are nested."""
        ours = event is None or getattr(event.data["dispatcher"], OURS, False)
        if ours and self.first:
            self.first = False
            _log.warning(FIRST)
        if self._depth == 0:
            if ours:
                signatures.begin()
            self._before = gc.get_threshold()
            if 0 < self._before[0] < SELDOM:
                gc.set_threshold(SELDOM, *self._before[1:])
        self._depth += 1

    def on_end(self, event: event.Event | None = None) -> None:
        """Handle the end of a compilation, successful or not."""
        self._depth -= 1
        if self._depth == 0:
            signatures.end()
            gc.set_threshold(*self._before)


_seldom = _CompileListener()
event.register("numba:compile", _seldom)


def decorated(
    decorate: Callable[[bool], T], module: str, stamp: str | None, variant: str = ""
) -> T:
    """Return `decorate(cache)`; `ContentLocator` keeps its code, but only with a stamp.

    `variant` distinguishes objects made from one function with different options.
    """
    # numba's setting for the place of code holds for all threads
    with global_compiler_lock:
        kept = stamp is not None and cache_root() is not None
        before, token = numba.config.CACHE_LOCATOR_CLASSES, _key.set((module, stamp or "", variant))
        if kept:
            numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{ContentLocator.__name__}"
        _seldom.on_start()  # a callback is compiled at once, without an event from numba
        try:
            made = decorate(kept)
        finally:
            _seldom.on_end()
            numba.config.CACHE_LOCATOR_CLASSES = before
            _key.reset(token)
    setattr(made, OURS, True)
    return made
