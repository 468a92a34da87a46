"""Disk: bytes that stay written, and names that change hands in one step.

A file is on the disk when it was synced, and it has its name there when its folder was synced. So
whoever renames syncs the content first and the folder afterwards: a power loss then leaves the old
name or the new content, never a name with half of it.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

WRITING = ".writing-"
"""In the name of what is not whole yet: `.NAME.writing-TOKEN`, beside NAME."""

FEW = 8
"""Files that are synced one by one rather than with all of their file system"""
RENAME_EXCHANGE = 2
"""Flag of renameat2(2): both names change hands at once."""
AT_FDCWD = -100
"""renameat2(2): paths are relative to the working folder."""
NO_SYNC = frozenset({errno.EINVAL, errno.ENOTSUP, errno.ENOSYS})
"""What file systems that cannot sync a folder say."""
NO_EXCHANGE = frozenset({errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EPERM})
"""What kernels and file systems that cannot exchange names say: NFS, FUSE, Linux before 3.15."""


def sync_file(path: Path) -> None:
    """Return when the file's content is on the disk; raises OSError."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_folder(path: Path) -> None:
    """Return when the names in a folder are on the disk; raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in NO_SYNC:
            raise
    finally:
        os.close(descriptor)


def sync_all(paths: Sequence[Path]) -> None:
    """Return when these files have their content and their names on the disk; raises OSError.

    Many files are synced with their whole file system, at once, where the system can do that.
    """
    syncfs = getattr(ctypes.CDLL(None, use_errno=True), "syncfs", None)
    if len(paths) <= FEW or syncfs is None:
        for path in paths:
            sync_file(path)
        for folder in {path.parent for path in paths}:
            sync_folder(folder)
        return
    descriptor = os.open(paths[0].parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        if syncfs(descriptor) != 0:
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code), str(paths[0].parent))
    finally:
        os.close(descriptor)


def sync_tree(folder: Path) -> None:
    """Return when a folder is on the disk with everything in it; raises OSError."""
    for path in files_below(folder):
        sync_file(path)
    for place, _, _ in os.walk(folder, topdown=False):
        sync_folder(Path(place))


def files_below(folder: Path) -> Iterator[Path]:
    """Every entry of a folder and of its folders that is no folder, in the order of their names;
    raises OSError where a folder cannot be read."""
    with os.scandir(folder) as entries:
        found = sorted(entries, key=lambda entry: entry.name)
    for entry in found:
        if entry.is_dir(follow_symlinks=False):
            yield from files_below(Path(entry.path))
        else:
            yield Path(entry.path)


def write_whole(path: Path, data: bytes) -> None:
    """Write a small file so that it is there with all of `data`, or as it was; raises OSError.

    What a kill leaves beside it is `.NAME.writing-TOKEN`, which nobody reads and `sweep` removes.
    """
    temporary = temporary_name(path)
    try:
        with temporary.open("wb") as file:
            lock(file.fileno())
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
            temporary.replace(path)
        sync_folder(path.parent)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def temporary_name(path: Path) -> Path:
    """A name beside `path` for what is to become it, that nobody has."""
    return path.with_name(f".{path.name}{WRITING}{secrets.token_hex(4)}")


def temporaries(path: Path) -> list[Path]:
    """What writers of `path` have, or left, beside it."""
    start = f".{path.name}{WRITING}"
    with contextlib.suppress(FileNotFoundError), os.scandir(path.parent) as entries:
        return [Path(entry.path) for entry in entries if entry.name.startswith(start)]
    return []


def lock(descriptor: int) -> bool:
    """Hold an open file or folder while this process lives; False when another one holds it.

    Where the file system has no locks this does nothing: then nothing is ever proven `dead`.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
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
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            gone = True
        except OSError:
            gone = False
        yield gone
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
                with dead(Path(place, name)) as gone:
                    if gone:
                        remove(Path(place, name))


def exchange(one: Path, other: Path) -> bool:
    """Let two entries of one file system change names, at once; False where that cannot be done.

    Raises:
      OSError: one of them is not there, or the disk refuses.
    """
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
