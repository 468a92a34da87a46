"""Whole files and folders: atomic writes, so that a name has complete content or none.

A writer fills a hidden folder `.NAME.writing-TOKEN` beside NAME, syncs it to the disk, and renames
the content to NAME in one step. Old content stays until that rename. The writer holds a lock on the
hidden folder, which the kernel drops when the process ends. The next writer of NAME removes the
hidden folders of dead writers, never the folder of a living one.

A folder replaces another folder by an exchange of names. If the file system has no exchange, the
old folder is moved into the hidden folder, and then the new folder is renamed to NAME. A kill
between these two renames leaves both folders complete, and `recover` does the second rename.
Writers call `recover` first; readers call it if NAME is missing.
"""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

from twin.errors import WriteError
from twin.records.storage.checksums import is_listed, write_checksums
from twin.records.storage.disk import (
    dead,
    exchange,
    is_temporary,
    lock,
    remove,
    sync,
    sync_tree,
    temporaries,
    temporary_name,
)
from twin.records.storage.store_path import Url, store_path

REPLACE = "use --overwrite (in Python overwrite=True)"
"""Way out in the error for a path that exists"""
REPLACED = ".replaced"
"""Name in the hidden folder for the old content while the new content is renamed"""
Ours = Callable[[Path], bool]
"""Function of a folder that is not empty: whether a writer may replace it"""


@contextlib.contextmanager
def whole_folder(
    path: str | Path, *, overwrite: bool = False, ours: Ours = is_listed
) -> Iterator[Path]:
    """Write a folder atomically: the context yields an empty folder, which becomes `path`.

    If the context ends with an error, `path` is unchanged. Else the folder also gets a list of its
    files' checksums (`twin.records.storage.checksums`).

    Args:
      overwrite: replace an existing folder, which stays until the new folder is complete.
      ours: says whether a folder may be replaced; an empty folder always may.

    Raises:
      WriteError: `path` exists and may not be replaced, or the disk refuses.
    """
    check_folder_target(path, overwrite=overwrite, ours=ours)
    with _locked_folder(path) as (target, hidden):
        content = hidden / target.name
        content.mkdir()
        yield content
        write_checksums(content)
        sync_tree(content)
        check_folder_target(path, overwrite=overwrite, ours=ours)  # again: another may have written
        take_place(content, target, hidden / REPLACED)


@contextlib.contextmanager
def whole_file(path: str | Path, *, overwrite: bool = True) -> Iterator[Path]:
    """Write a file atomically: the context yields a temporary path, which becomes `path`
    unless the context ends with an error.

    Args:
      overwrite: replace an existing file.

    Raises:
      WriteError: `path` exists and may not be replaced, or the disk refuses.
    """
    check_file_target(path, overwrite=overwrite)
    with _locked_folder(path) as (target, hidden):
        content = hidden / target.name
        yield content
        if target.exists():
            content.chmod(stat.S_IMODE(target.stat().st_mode))
        sync(content)
        check_file_target(path, overwrite=overwrite)  # again: another writer may have written
        content.replace(target)
        sync(target.parent)


def check_folder_target(
    path: str | Path, *, overwrite: bool = False, ours: Ours = is_listed
) -> None:
    """Raise the errors of `whole_folder` before long work begins.

    Raises:
      WriteError: `path` exists and may not be replaced, or the disk refuses.
    """
    target = _resolve_target(path)
    recover(target)
    if not target.exists():
        check_place(target)
        return
    if not target.is_dir():
        raise WriteError(f"{path} exists and is not a folder; choose another name")
    if not any(target.iterdir()):
        return
    if not ours(target):
        why = "glider-twin did not write it"
        if is_listed(target):
            why = "is damaged, or another thing of glider-twin's than what is to be written"
        raise WriteError(f"{path} exists and {why}; remove it by hand or choose another name")
    if not overwrite:
        raise WriteError(f"{path} already exists; {REPLACE} or choose another name")


def check_file_target(path: str | Path, *, overwrite: bool = True) -> None:
    """Raise the errors of `whole_file` before long work begins.

    Raises:
      WriteError: `path` exists and may not be replaced, or the disk refuses.
    """
    target = _resolve_target(path)
    check_place(target)
    if target.exists() and not target.is_file():
        what = "a folder" if target.is_dir() else "not a plain file"
        raise WriteError(f"{path} is {what}; give the name of a file")
    if target.exists() and not overwrite:
        raise WriteError(f"{path} already exists; {REPLACE} or choose another name")


def check_place(target: Path) -> None:
    """Check that a path can be written, before long work: make a folder beside it and remove it.

    Raises:
      WriteError: a file has the name of a parent folder, or the disk refuses.
    """
    place = next(place for place in target.parents if place.exists())
    if not place.is_dir():
        raise WriteError(f"cannot write {target}: {place} is a file, not a folder")
    tried = temporary_name(place / target.name)
    try:
        tried.mkdir()
        tried.rmdir()
    except OSError as error:
        raise WriteError(
            f"cannot write {target}: {place}: {error.strerror or error}; choose another place"
        ) from error


def recover(path: str | Path) -> None:
    """Rename a complete folder whose writer was killed between the two renames of a replacement.

    Does nothing if `path` exists or the writer lives.
    """
    target = _resolve_target(path)
    if not target.exists():
        clean(target)


def clean(target: Path) -> None:
    """Remove the hidden folders of dead writers of `target`; first finish a replacement that one
    of them began."""
    for hidden in temporaries(target):
        with dead(hidden) as gone:
            if not gone:
                continue
            if (hidden / REPLACED).is_dir() and not target.exists():
                new = hidden / target.name
                # the old content was moved aside only after the new content was complete
                (new if new.is_dir() else hidden / REPLACED).rename(target)
            remove(hidden)


def _resolve_target(path: str | Path) -> Path:
    """Resolve links: a link stays, and the file or folder that it points to is replaced.

    Raises:
      WriteError: `path` is the address of an object storage.
    """
    if isinstance(address := store_path(path), Url):
        raise WriteError(
            f"{address} is in an object storage, where only `factory generate` writes: give a path "
            "of this machine and copy what is there"
        )
    return Path(os.path.realpath(path))


@contextlib.contextmanager
def _locked_folder(path: str | Path) -> Iterator[tuple[Path, Path]]:
    """Yield the resolved path and a locked hidden folder beside it, which is removed at the end."""
    target = _resolve_target(path)
    hidden, descriptor = None, None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        clean(target)
        hidden, descriptor = _make_hidden_folder(target)
        yield target, hidden
    except OSError as error:
        if not _is_write_error(error, target):
            raise
        why = error.strerror or str(error)
        if error.filename is not None and Path(os.fsdecode(error.filename)) in target.parents:
            why = f"{os.fsdecode(error.filename)}: {why}"
        raise WriteError(
            f"cannot write {path}: {why}; nothing half-written is left: make room or choose "
            "another place, then give the command again"
        ) from error
    except KeyboardInterrupt as interrupt:
        if interrupt.args:
            raise
        raise KeyboardInterrupt(
            f"nothing half-written is left under {path}; give the command again"
        ) from None
    finally:
        if hidden is not None and (target.exists() or not (hidden / REPLACED).exists()):
            remove(hidden)
        if descriptor is not None:
            os.close(descriptor)


def _is_write_error(error: OSError, target: Path) -> bool:
    """Return whether an error comes from writing `target`, not from a file that the caller read."""
    if error.filename is None:
        return True
    place = Path(os.path.realpath(os.fsdecode(error.filename)))
    return place in (target, *target.parents) or any(
        is_temporary(one, target) for one in (place, *place.parents)
    )


def _make_hidden_folder(target: Path) -> tuple[Path, int]:
    """Make a hidden folder beside the target; returns it and the descriptor that holds its lock."""
    while True:
        hidden = temporary_name(target)
        hidden.mkdir()  # below /proc this raises ENOENT, though the parent exists
        try:
            descriptor = os.open(hidden, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:
            continue  # another writer's `clean` removed it before the lock
        with contextlib.suppress(FileNotFoundError):
            if lock(descriptor) and hidden.stat().st_ino == os.fstat(descriptor).st_ino:
                return hidden, descriptor
        os.close(descriptor)


def take_place(content: Path, target: Path, aside: Path) -> None:
    """Rename complete content to `target`; `aside` is a temporary path for the old content."""
    if target.exists() and any(target.iterdir()):
        content.chmod(stat.S_IMODE(target.stat().st_mode))
        if not exchange(content, target):
            target.rename(aside)
            try:
                content.rename(target)
            except OSError:
                aside.rename(target)
                raise
    else:
        content.rename(target)  # also replaces an empty folder
    sync(target.parent)
