"""Whole: what a command writes is under its name completely, or not at all.

New content grows in a hidden folder `.NAME.writing-TOKEN` beside NAME, is synced to the disk, and
takes its name in one rename. Until then what was there stays. The writer holds a lock on the hidden
folder, which the kernel drops when the process ends in whatever way: the next writer of the same
name removes what others left, and never what a living one works in.

A folder takes the place of another one by an exchange of names. Where the file system has none,
the old one is moved aside into the hidden folder, and then the new one takes its name. A kill
between these two leaves both there, whole: `recover` finishes the second step. The next writer
calls it, and readers do when nothing is under the name.
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

REPLACED = ".replaced"
"""Where in the hidden folder the old content waits while the new one takes its name."""
Ours = Callable[[Path], bool]
"""Whether a folder that is not empty may be replaced."""


@contextlib.contextmanager
def whole_folder(
    path: str | Path, *, overwrite: bool = False, ours: Ours = is_listed
) -> Iterator[Path]:
    """Write a folder; the context yields an empty one, which becomes `path` when it ends well.

    Every file then has its checksum in `twin.records.storage.checksums`' list. When the context
    ends with an error, `path` is as it was.

    Args:
      overwrite: take the place of what is there, which stays until the new folder is complete.
      ours: what may be replaced; an empty folder always may.

    Raises:
      WriteError: something is in the way, or the disk refuses.
    """
    check_folder_target(path, overwrite=overwrite, ours=ours)
    with _beside(path) as (target, hidden):
        content = hidden / target.name
        content.mkdir()
        yield content
        write_checksums(content)
        sync_tree(content)
        check_folder_target(path, overwrite=overwrite, ours=ours)  # another writer may have ended
        take_place(content, target, hidden / REPLACED)


@contextlib.contextmanager
def whole_file(path: str | Path, *, overwrite: bool = True) -> Iterator[Path]:
    """Write a file; the context yields a path of the same name, to be written by whatever writes
    files, which becomes `path` when the context ends well. Else `path` is as it was.

    Args:
      overwrite: take the place of a file that is there.

    Raises:
      WriteError: something is in the way, or the disk refuses.
    """
    check_file_target(path, overwrite=overwrite)
    with _beside(path) as (target, hidden):
        content = hidden / target.name
        yield content
        if target.exists():
            content.chmod(stat.S_IMODE(target.stat().st_mode))
        sync(content)
        check_file_target(path, overwrite=overwrite)  # another writer may have ended
        content.replace(target)
        sync(target.parent)


def check_folder_target(
    path: str | Path, *, overwrite: bool = False, ours: Ours = is_listed
) -> None:
    """Refuse what `whole_folder` would refuse, before long work.

    Raises:
      WriteError: something is in the way.
    """
    target = _target(path)
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
        raise WriteError(f"{path} already exists; use --overwrite or choose another name")


def check_file_target(path: str | Path, *, overwrite: bool = True) -> None:
    """Refuse what `whole_file` would refuse, before long work.

    Raises:
      WriteError: something is in the way.
    """
    target = _target(path)
    check_place(target)
    if target.exists() and not target.is_file():
        what = "a folder" if target.is_dir() else "not a plain file"
        raise WriteError(f"{path} is {what}; give the name of a file")
    if target.exists() and not overwrite:
        raise WriteError(f"{path} already exists; use --overwrite or choose another name")


def check_place(target: Path) -> None:
    """Refuse a place in which nothing can be written, before long work: one is made and removed.

    Raises:
      WriteError: a file stands where a folder of the path must be, or the disk refuses.
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
    """Give a folder its name when its writer was killed between the two renames that give it.

    Does nothing where something is under the name, or its writer lives.
    """
    target = _target(path)
    if not target.exists():
        clean(target)


def clean(target: Path) -> None:
    """Remove what writers of this target left that are gone, after a rename that one of them began
    is finished."""
    for hidden in temporaries(target):
        with dead(hidden) as gone:
            if not gone:
                continue
            if (hidden / REPLACED).is_dir() and not target.exists():
                new = hidden / target.name
                # the old one was moved aside when the new one was complete
                (new if new.is_dir() else hidden / REPLACED).rename(target)
            remove(hidden)


def _target(path: str | Path) -> Path:
    """What is to be written: a link stays, and what it points to is replaced.

    Raises:
      WriteError: it is the address of an object storage.
    """
    if isinstance(address := store_path(path), Url):
        raise WriteError(
            f"{address} is in an object storage, where only `factory generate` writes: give a path "
            "of this machine and copy what is there"
        )
    return Path(os.path.realpath(path))


@contextlib.contextmanager
def _beside(path: str | Path) -> Iterator[tuple[Path, Path]]:
    """The true path of a target and a locked folder beside it, which goes away in the end."""
    target = _target(path)
    hidden, descriptor = None, None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        clean(target)
        hidden, descriptor = _hidden(target)
        yield target, hidden
    except OSError as error:
        if not _is_of_writing(error, target):
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


def _is_of_writing(error: OSError, target: Path) -> bool:
    """Whether an error comes from writing, not from something that the body of a context read."""
    if error.filename is None:
        return True
    place = Path(os.path.realpath(os.fsdecode(error.filename)))
    return place in (target, *target.parents) or any(
        is_temporary(one, target) for one in (place, *place.parents)
    )


def _hidden(target: Path) -> tuple[Path, int]:
    """A new folder beside the target, and the open descriptor that holds its lock."""
    while True:
        hidden = temporary_name(target)
        hidden.mkdir()  # /proc says ENOENT, though the parent is there
        try:
            descriptor = os.open(hidden, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:
            continue  # a writer that cleaned at this moment took it away
        with contextlib.suppress(FileNotFoundError):
            if lock(descriptor) and hidden.stat().st_ino == os.fstat(descriptor).st_ino:
                return hidden, descriptor
        os.close(descriptor)


def take_place(content: Path, target: Path, aside: Path) -> None:
    """Give complete content its name; `aside` is where the old content may wait."""
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
        content.rename(target)  # onto an empty folder too
    sync(target.parent)
