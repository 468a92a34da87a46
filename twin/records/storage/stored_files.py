"""Files: where a store's bytes are kept, by keys such as `true_depth/c/0/0`.

A folder of this machine or an object storage: what goes through `Files` need not know. A file
appears under its key whole or not at all.
"""

from __future__ import annotations

import abc
import errno
import hashlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin.bounded import MOST_TEXT, check_regular
from twin.records.storage.disk import (
    files_below,
    remove,
    sync_all,
    temporary_name,
    write_whole,
)


@dataclass(frozen=True)
class FileSum:
    """Size and hash of a file."""

    bytes: int
    sha256: str
    """hexadecimal"""


def file_sum(path: Path) -> FileSum:
    """Size and hash of a file of this machine, read piece by piece; raises OSError, as OddFile
    where it is no regular file."""
    check_regular(path)
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return FileSum(file.tell(), digest)


class GiantFile(OSError, ValueError):
    """A file is larger than its kind ever is: it is damaged, or made to fill the memory."""


class Files(abc.ABC):
    """A place for files; picklable, so that tasks on other machines find it again."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """How people call the place: a path or an address."""

    @abc.abstractmethod
    def below(self, key: str) -> Files:
        """The place that begins at `key`."""

    @abc.abstractmethod
    def read(self, key: str) -> bytes:
        """All of a file.

        Raises:
          FileNotFoundError: there is none. OSError: it cannot be read.
        """

    def read_small(self, key: str, most: int = MOST_TEXT) -> bytes:
        """All of a file of at most `most` bytes; errors as of `read`, and GiantFile."""
        size = self.size(key)
        if size is not None and size > most:
            reason = f"it has {size} bytes, which no such file needs"
            raise GiantFile(errno.EFBIG, reason, f"{self.name}/{key}")
        return self.read(key)

    @abc.abstractmethod
    def fetch(self, key: str, folder: Path) -> Path:
        """A file of this machine with the same content, to read: the file itself where it is
        here, else a copy in `folder`; errors as of `read`."""

    @abc.abstractmethod
    def give_back(self, path: Path) -> None:
        """Remove what `fetch` gave, where it is a copy."""

    @abc.abstractmethod
    def write(self, key: str, data: bytes) -> None:
        """Make or replace a file; raises OSError."""

    @abc.abstractmethod
    def write_safe(self, key: str, data: bytes) -> None:
        """`write` a small file; it is safe from a loss of power when this returns."""

    @abc.abstractmethod
    def take(self, key: str, path: Path) -> None:
        """Make or replace a file from one of this machine, which is moved away; raises OSError."""

    @abc.abstractmethod
    def settle(self) -> None:
        """Return when all that was written through this object is safe from a loss of power;
        raises OSError."""

    @abc.abstractmethod
    def size(self, key: str) -> int | None:
        """Size [bytes] of a file; None when there is none."""

    @abc.abstractmethod
    def sum(self, key: str) -> FileSum:
        """Size and hash of a file, read piece by piece; errors as of `read`."""

    @abc.abstractmethod
    def sizes(self) -> Iterator[tuple[str, int]]:
        """Key and size [bytes] of every file, in no order; raises OSError."""

    @abc.abstractmethod
    def folders(self) -> list[str]:
        """First parts of the keys that have more than one, sorted; raises OSError."""

    @abc.abstractmethod
    def zarr_store(self) -> Any:
        """What zarr and xarray open to read."""

    @abc.abstractmethod
    def remove(self, key: str) -> None:
        """Remove a file if there is one; raises OSError."""

    @abc.abstractmethod
    def remove_all(self) -> None:
        """Remove every file as far as that is allowed."""

    def exists(self, key: str) -> bool:
        """Whether there is such a file."""
        return self.size(key) is not None

    def all_keys(self) -> Iterator[str]:
        """Keys of all files, in no order; raises OSError."""
        return (key for key, _ in self.sizes())

    def stored_bytes(self) -> int:
        """Size of all files together; raises OSError."""
        return sum(size for _, size in self.sizes())

    def put(self, key: str, data: bytes) -> FileSum:
        """`write`, and the checksum of what was written."""
        self.write(key, data)
        return FileSum(len(data), hashlib.sha256(data).hexdigest())

    def move_in(self, key: str, path: Path) -> FileSum:
        """`take`, and the checksum of what was taken."""
        found = file_sum(path)
        self.take(key, path)
        return found


class LocalFiles(Files):
    """A folder of this machine, made when the first file is written."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._fresh: set[Path] = set()
        """written and perhaps not on the disk yet"""

    @property
    def name(self) -> str:
        """Its path."""
        return str(self.folder)

    def below(self, key: str) -> LocalFiles:
        """A folder in it."""
        return LocalFiles(self.folder / key)

    def read(self, key: str) -> bytes:
        """All of a file."""
        return self.fetch(key, self.folder).read_bytes()

    def fetch(self, key: str, folder: Path) -> Path:
        """The file."""
        check_regular(self.folder / key)
        return self.folder / key

    def give_back(self, path: Path) -> None:
        """It is the file itself: it stays."""

    def write(self, key: str, data: bytes) -> None:
        """Write it under another name, then give it its own."""
        target = self._parent(key)
        temporary = temporary_name(target)
        try:
            temporary.write_bytes(data)
            temporary.replace(target)
        except BaseException:
            remove(temporary)
            raise
        self._fresh.add(target)

    def write_safe(self, key: str, data: bytes) -> None:
        """Sync it before it has its name."""
        target = self.folder / key
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, data)

    def take(self, key: str, path: Path) -> None:
        """Give a file of the same file system its name."""
        target = self._parent(key)
        path.replace(target)
        self._fresh.add(target)

    def settle(self) -> None:
        """Sync what was written."""
        sync_all(sorted(self._fresh), {path.parent for path in self._fresh})
        self._fresh.clear()

    def size(self, key: str) -> int | None:
        """Size of a file; raises OddFile where it is no regular file."""
        try:
            return check_regular(self.folder / key)
        except (FileNotFoundError, NotADirectoryError):
            return None

    def exists(self, key: str) -> bool:
        """Whether anything is there."""
        return (self.folder / key).exists()

    def sum(self, key: str) -> FileSum:
        """Size and hash of a file."""
        return file_sum(self.folder / key)

    def sizes(self) -> Iterator[tuple[str, int]]:
        """All files below the folder, those of a folder in the order of their names."""
        if self.folder.is_dir():
            for path in files_below(self.folder):
                yield path.relative_to(self.folder).as_posix(), path.lstat().st_size

    def all_keys(self) -> Iterator[str]:
        """Keys of all files, of which some may go away meanwhile."""
        if self.folder.is_dir():
            yield from (p.relative_to(self.folder).as_posix() for p in files_below(self.folder))

    def folders(self) -> list[str]:
        """Folders in the folder."""
        try:
            with os.scandir(self.folder) as entries:
                return sorted(entry.name for entry in entries if entry.is_dir())
        except (FileNotFoundError, NotADirectoryError):
            return []

    def zarr_store(self) -> str:
        """The folder's path."""
        return str(self.folder)

    def remove(self, key: str) -> None:
        """Unlink a file."""
        (self.folder / key).unlink(missing_ok=True)
        self._fresh.discard(self.folder / key)

    def remove_all(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _parent(self, key: str) -> Path:
        """The file of a key, in a folder that is there."""
        target = self.folder / key
        target.parent.mkdir(parents=True, exist_ok=True)
        return target
