"""Folder: where compiled code is kept, in a place that no other user can write.

Compiled code is run, so whoever can write it, or rename a folder above it, can run code as this
user. Every level up to the root is checked, and no place has a name in a folder that others write.

Locator: tells numba where a function's code is kept and what it was made from.
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
"""[day] Versions that no process has used for longer are removed."""
TOUCH_DAYS = 1.0
"""[day] A version in use is marked as used again after this time."""
_DAY = 86_400.0
_PACKAGE = Path(__file__).resolve().parent.parent


@functools.cache
def cache_root() -> Path | None:
    """The first trusted folder of `candidates`, created.

    A folder that cannot be written is passed over like one that cannot be trusted. None, and a
    warning that says why, when none is left.
    """
    reasons = []
    for candidate in candidates():
        folder = candidate.resolve()  # once: a link that is turned elsewhere later changes nothing
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
    """Beside the package where it belongs to this user, then the user's cache."""
    if not hasattr(os, "getuid") or _PACKAGE.stat().st_uid == os.getuid():
        yield _PACKAGE / "__pycache__" / "compiled"
    with contextlib.suppress(RuntimeError):  # no home folder is known
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "glider-twin"


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

    One that is a link, or that others wrote while `root` was still open to them, is removed first.
    Creating one removes the versions beside it that no process has used for `KEPT_DAYS`: a process
    marks what it loads, so nothing that may still be read goes.
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


T = TypeVar("T")
_now: ContextVar[tuple[str, str, str]] = ContextVar("module, stamp, variant of what is decorated")


class ContentLocator:
    """One folder for each version of each module, so that versions never share an index.

    It answers what numba asks of one of `numba.config.CACHE_LOCATOR_CLASSES`.
    """

    def __init__(self, function: FunctionType, file: str) -> None:
        module, self._stamp, self._variant = _now.get()
        root = cache_root()
        assert root is not None
        self._folder = version_folder(root, f"{module}-{self._stamp}")
        self._line = function.__code__.co_firstlineno
        self._py_file = file  # numba names it in warnings

    def get_cache_path(self) -> str:
        """The folder of this version."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Create the folder; raises OSError when it cannot be written."""
        self._folder.mkdir(mode=0o700, exist_ok=True)
        tempfile.TemporaryFile(dir=self._folder).close()

    def get_source_stamp(self) -> str:
        """The content's hash."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """The line of the function, and the variant: two of one name in a module are told apart."""
        return f"{self._line}{self._variant}"

    @classmethod
    def from_function(cls, py_func: FunctionType, py_file: str) -> Self:
        """numba's entry."""
        return cls(py_func, py_file)


NOTE = "note.txt"
"""Name of the file beside the code of one version"""


def keep_note(module: str, stamp: str | None, text: str) -> None:
    """Keep a text, which may be empty, beside the code of one version, for other processes.

    A folder that cannot be written keeps none, as it keeps no code.
    """
    root = cache_root()
    if stamp is None or root is None:
        return
    with contextlib.suppress(OSError):
        folder = version_folder(root, f"{module}-{stamp}")
        with tempfile.NamedTemporaryFile("w", dir=folder, delete=False, encoding="utf-8") as file:
            file.write(text)
        Path(file.name).replace(folder / NOTE)  # whole or not at all


def kept_note(module: str, stamp: str | None) -> str | None:
    """The text that a process has kept beside the code of one version; None: there is none."""
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
"""Told when nothing is kept yet"""
_log = logging.getLogger(__name__)
OURS = "_made_by_twin_compiled"
"""Attribute of numba's objects that are made of our functions"""
SELDOM = 50_000
"""Objects from one look for garbage to the next while numba compiles"""


class _SeldomCollected(event.Listener):
    """Python looks seldom for garbage while numba compiles: that saves 7 % of the time.

    While a function of ours compiles, and those within it, `signatures` are remembered.

    Whoever waits for the very first compiling is told why. numba compiles, and so calls this, under
    one lock.
    """

    first = False
    """Nothing was kept when this process began, and nothing is told yet"""

    def __init__(self) -> None:
        self._depth, self._before = 0, gc.get_threshold()

    def on_start(self, event: event.Event | None = None) -> None:
        """numba begins a function; those that it calls come within."""
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
        """numba has made it, or failed."""
        self._depth -= 1
        if self._depth == 0:
            signatures.end()
            gc.set_threshold(*self._before)


_seldom = _SeldomCollected()
event.register("numba:compile", _seldom)


def decorated(
    decorate: Callable[[bool], T], module: str, stamp: str | None, variant: str = ""
) -> T:
    """Result of `decorate(cache)`, kept where `ContentLocator` says; not kept without a stamp.

    Two that are made of one function with other options have two variants.
    """
    # where code is kept is numba's setting for all threads
    with global_compiler_lock:
        kept = stamp is not None and cache_root() is not None
        before, token = numba.config.CACHE_LOCATOR_CLASSES, _now.set((module, stamp or "", variant))
        if kept:
            numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{ContentLocator.__name__}"
        _seldom.on_start()  # a callback is compiled at once, and numba tells nobody
        try:
            made = decorate(kept)
        finally:
            _seldom.on_end()
            numba.config.CACHE_LOCATOR_CLASSES = before
            _now.reset(token)
    setattr(made, OURS, True)
    return made
