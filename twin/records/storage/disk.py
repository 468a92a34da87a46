"""Disk: bytes that survive a power cut, and renames that happen in one step.

A file is on the disk when it was synced, and it has its name there when its folder was synced. So
whoever renames syncs the content first and the folder afterwards: a power loss then leaves the old
name or the new content, never a name with half of it.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

WRITING = ".writing-"
"""In the name of what is not whole yet: `.NAME.writing-TOKEN`, beside NAME."""

RENAME_EXCHANGE = 2
"""Flag of renameat2(2): both names change hands at once."""
AT_FDCWD = -100
"""renameat2(2): paths are relative to the working folder."""
SYNCS_AT_ONCE = 16
NO_SYNC = frozenset({errno.EINVAL, errno.ENOTSUP, errno.ENOSYS})
"""What file systems that cannot sync a folder say."""
NO_EXCHANGE = frozenset({errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EPERM})
"""What kernels and file systems that cannot exchange names say: NFS, FUSE, Linux before 3.15."""


def sync(path: Path) -> None:
    """Return when a file's content, or the names in a folder, are on the disk; raises OSError."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if not (error.errno in NO_SYNC and path.is_dir()):
            raise
    finally:
        os.close(descriptor)


def sync_all(paths: Iterable[Path]) -> None:
    """`sync` many at once, which a disk takes together: 150 files 0.04 s instead of 1.3 s."""
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(SYNCS_AT_ONCE) as threads:
        list(threads.map(sync, paths))


def sync_tree(folder: Path) -> None:
    """Return when a folder is on the disk with everything in it; raises OSError."""
    sync_all([*files_below(folder), *(Path(place) for place, _, _ in os.walk(folder))])


def files_below(folder: Path) -> Iterator[Path]:
    """Every entry of a folder and of its folders that is not a folder, in the order of their names;
    raises OSError where a folder cannot be read."""
    with os.scandir(folder) as entries:
        found = sorted(entries, key=lambda entry: entry.name)
    for entry in found:
        if entry.is_dir(follow_symlinks=False):
            yield from files_below(Path(entry.path))
        else:
            yield Path(entry.path)


def write_whole(path: Path, data: bytes, *, safe: bool = True) -> None:
    """Write a small file so that it is there with all of `data`, or as it was; raises OSError.

    A kill leaves `.NAME.writing-TOKEN` beside it, which nobody reads and `sweep` removes.

    Args:
      safe: whether it is safe from a loss of power when this returns.
    """
    temporary = temporary_name(path)
    try:
        temporary.write_bytes(data)
        if safe:
            sync(temporary)
        temporary.replace(path)
    except BaseException:
        remove(temporary)
        raise
    if safe:
        sync(path.parent)


def temporary_name(path: Path) -> Path:
    """An unused name beside `path`, for a file or folder that will be renamed to it."""
    return path.with_name(f".{path.name}{WRITING}{os.urandom(4).hex()}")


def is_temporary(one: Path, path: Path) -> bool:
    """Whether `one` has a name that a writer of `path` gives to what it has beside it."""
    return one.parent == path.parent and one.name.startswith(f".{path.name}{WRITING}")


def temporaries(path: Path) -> list[Path]:
    """What writers of `path` have, or left, beside it."""
    missing = contextlib.suppress(FileNotFoundError, NotADirectoryError)
    with missing, os.scandir(path.parent) as entries:
        return [Path(e.path) for e in entries if is_temporary(Path(e.path), path)]
    return []


def lock(descriptor: int, *, shared: bool = False, otherwise: bool = True) -> bool:
    """Hold an open file or folder while this process lives; False when another one holds it.

    Args:
      shared: together with others that share it.
      otherwise: answer where the file system has no locks.
    """
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        return otherwise and not isinstance(error, BlockingIOError)
    return True


@contextlib.contextmanager
def dead(path: Path) -> Iterator[bool]:
    """Whether the process that wrote a temporary file or folder is gone; nobody else finds so
    until the context ends."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    except OSError:
        yield False
        return
    try:
        yield lock(descriptor, otherwise=False)
    finally:
        os.close(descriptor)


def remove(path: Path) -> None:
    """Remove a file or a folder with all that is in it, as far as the disk lets it."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with contextlib.suppress(OSError):
        path.unlink()


def sweep(folder: Path) -> None:
    """Remove what processes that are gone left half-written in a folder and its folders."""
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            if name.startswith(".") and WRITING in name:
                with dead(path := Path(place, name)) as gone:
                    if gone:
                        remove(path)


def exchange(one: Path, other: Path) -> bool:
    """Let two entries of one file system change names, at once; False where that cannot be done.

    Raises:
      OSError: one of them is not there, or the disk refuses.
    """
    import ctypes

    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:  # a C library without it
        return False
    names = os.fsencode(one), os.fsencode(other)
    if rename(AT_FDCWD, names[0], AT_FDCWD, names[1], RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in NO_EXCHANGE:
        return False
    raise OSError(code, os.strerror(code), str(other))
