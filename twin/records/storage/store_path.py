"""Store path: a path of this machine or the address of an object storage.

`Files` reads and writes a store's files there by keys such as `true_depth/c/0/0`. A key has its
complete file or none.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePath, PurePosixPath
from typing import Any, NamedTuple, NoReturn, TypeAlias

from twin.bounded import MOST_TEXT, check_regular
from twin.errors import InputError, unknown_name
from twin.lazy import resolve
from twin.records.storage.disk import entries_below, sync_all, write_whole

SCHEMES = {"s3": "Amazon S3 and what speaks like it", "gs": "Google Cloud", "az": "Azure"}
"""Allowed schemes of an address (the part before ://), with the storage that each one means"""
MARK = "://"
_ADDRESS = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):(?:/+(.*))?", re.DOTALL)
"""Pattern of an address with both slashes, or with the single slash that `Path` leaves"""


class Url(PurePosixPath):
    """Address such as s3://bucket/folder/missions.zarr, with the name and parents of a path.

    An address is no path of this machine: functions that open files refuse it.
    """

    def __str__(self) -> str:
        """Return the address with both slashes; a path keeps only one."""
        return super().__str__().replace(":/", MARK, 1)

    def __fspath__(self) -> NoReturn:
        raise TypeError(f"{self} is not a path of this machine")


StorePath: TypeAlias = Path | Url


def store_path(place: str | PurePath) -> StorePath:
    """Read a text as a path or an address. A `Path` made from an address gives the address.

    Raises:
      InputError: an address with an unknown scheme, or one that names no store.
    """
    found = _ADDRESS.fullmatch(str(place))
    if isinstance(place, Url) or found is None:
        return place if isinstance(place, Path | Url) else Path(place)
    scheme, rest = found[1], found[2] or ""
    if scheme not in SCHEMES:
        raise InputError(
            f"{scheme}{MARK}{rest}: {unknown_name('kind of address', scheme, SCHEMES)}; without "
            f"{MARK} it is a path of this machine"
        )
    address = Url(f"{scheme}{MARK}{rest}")
    if len(address.parts) < 3 or ".." in rest.split("/"):
        raise InputError(
            f"{scheme}{MARK}{rest} names no store: give the bucket and a name in it, such as "
            f"{scheme}{MARK}BUCKET/missions.zarr"
        )
    return address


def named(path: Path) -> Path:
    """Return a path with a name: `.` and `..` are resolved, because nothing can lie beside them."""
    return path if path.name not in ("", "..") else path.resolve()


def check_addresses(place: object) -> None:
    """Refuse an address with an unknown scheme, before it becomes a folder of this machine.

    Args:
      place: any value; a path, or each path of a sequence, is checked.

    Raises:
      InputError: as `store_path`.
    """
    for one in place if isinstance(place, tuple | list) else (place,):
        if isinstance(one, PurePath):
            store_path(one)


class FileSum(NamedTuple):
    """Size [byte] and hash of a file."""

    bytes: int
    sha256: str
    """SHA-256 of the content, hexadecimal"""


def file_sum(path: Path) -> FileSum:
    """Compute size and hash of a local file; raises OSError, or OddFile if not regular."""
    check_regular(path)
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return FileSum(file.tell(), digest)


class GiantFile(OSError, ValueError):
    """Error of a file that is too large for its type: damaged, or made to fill the memory."""


class Files:
    """Files of a folder of this machine, which the first write makes; `ObjectFiles` is the class
    for an object storage. Instances can be pickled for tasks on other machines.

    Methods that access a file raise OSError if the access fails, and FileNotFoundError if there is
    no such file.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    @property
    def name(self) -> str:
        """Path of the folder, or address of the storage, for messages."""
        return str(self.folder)

    def read(self, key: str) -> bytes:
        """Read a file."""
        check_regular(self.folder / key)
        return (self.folder / key).read_bytes()

    def read_small(self, key: str, most: int = MOST_TEXT) -> bytes:
        """Read a file of at most `most` bytes; raises GiantFile for a larger file."""
        size = self.size(key)
        if size is not None and size > most:
            reason = f"it has {size} bytes, which no such file needs"
            raise GiantFile(errno.EFBIG, reason, f"{self.name}/{key}")
        return self.read(key)

    def write(self, key: str, data: bytes, *, safe: bool = False) -> None:
        """Make or replace a file: write it under a temporary name, then rename it.

        Args:
          safe: whether the file must survive a loss of power once this returns.
        """
        target = self.folder / key
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, data, safe=safe)

    def take(self, files: Mapping[str, Path]) -> None:
        """Move files of this machine to the given keys, replacing files there; they survive a loss
        of power once this returns."""
        sync_all(files.values())
        targets = {self.folder / key: path for key, path in files.items()}
        for target, path in targets.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)
        sync_all({target.parent for target in targets})

    def size(self, key: str) -> int | None:
        """Size [byte] of a file; None if there is none. Raises OddFile if it is not regular."""
        try:
            return check_regular(self.folder / key)
        except (FileNotFoundError, NotADirectoryError):
            return None

    def exists(self, key: str) -> bool:
        """Return whether the key has a file or folder."""
        return (self.folder / key).exists()

    def sum(self, key: str) -> FileSum:
        """Compute size and hash of a file, read block by block."""
        return file_sum(self.folder / key)

    def sizes(self) -> Iterator[tuple[str, int]]:
        """Yield key and size [byte] of every file, sorted by name in each folder. Files that are
        removed meanwhile are skipped."""
        begin = len(str(self.folder / "_")) - 1
        for entry in entries_below(self.folder) if self.folder.is_dir() else ():
            with contextlib.suppress(FileNotFoundError):
                yield entry.path[begin:], entry.stat(follow_symlinks=False).st_size

    def all_keys(self) -> Iterator[str]:
        """Keys of all files."""
        return (key for key, _ in self.sizes())

    def stored_bytes(self) -> int:
        """Size [byte] of all files together."""
        return sum(size for _, size in self.sizes())

    def folders(self) -> list[str]:
        """First parts of the keys that have more than one part, sorted."""
        try:
            with os.scandir(self.folder) as entries:
                return sorted(entry.name for entry in entries if entry.is_dir())
        except (FileNotFoundError, NotADirectoryError):
            return []

    def zarr_store(self) -> Any:
        """Return a path or store object that zarr and xarray open to read."""
        return str(self.folder)

    def remove(self, key: str) -> None:
        """Remove a file if there is one."""
        (self.folder / key).unlink(missing_ok=True)

    def remove_all(self) -> None:
        """Remove every file as far as the disk allows."""
        shutil.rmtree(self.folder, ignore_errors=True)


def files_at(place: str | StorePath) -> Files:
    """Return `Files` for a folder of this machine, or `ObjectFiles` for an address.

    Raises:
      InputError: the address cannot be used, or obstore is not installed.
    """
    path = store_path(place)
    if isinstance(path, Path):
        return Files(path)
    found: Files = resolve("twin.records.storage.object_storage:ObjectFiles")(path)
    return found
