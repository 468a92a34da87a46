"""Store path: where a store lies, a path of this machine or the address of an object storage.

Files: a store's bytes there, by keys such as `true_depth/c/0/0`. A file appears under its key whole
or not at all.
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
from twin.records.storage.disk import files_below, sync_all, write_whole

SCHEMES = {"s3": "Amazon S3 and what speaks like it", "gs": "Google Cloud", "az": "Azure"}
"""What may stand before :// in an address, and whose it is"""
MARK = "://"
_ADDRESS = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):(?:/+(.*))?", re.DOTALL)
"""An address, with both slashes or with the one that a path makes of them"""


class Url(PurePosixPath):
    """An address such as s3://bucket/folder/missions.zarr, with the names and parents of paths.

    It is no path of this machine: what opens files refuses it.
    """

    def __str__(self) -> str:
        """With both slashes, which paths make one of."""
        return super().__str__().replace(":/", MARK, 1)

    def __fspath__(self) -> NoReturn:
        raise TypeError(f"{self} is not a path of this machine")


StorePath: TypeAlias = Path | Url


def store_path(place: str | PurePath) -> StorePath:
    """The path or address that a text means. A `Path` made of an address is taken for it.

    Raises:
      InputError: an address of a kind that nobody can read, or one that names no store.
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
    """A path with the name of its folder; `.` and `..` have none, beside which nothing can lie."""
    return path if path.name not in ("", "..") else path.resolve()


def check_addresses(place: object) -> None:
    """Refuse an address of a kind that nobody can read, before it becomes a folder of this machine.

    Args:
      place: any value; a path, or a sequence of paths, is looked at.

    Raises:
      InputError: it is one, as `store_path` says.
    """
    for one in place if isinstance(place, tuple | list) else (place,):
        if isinstance(one, PurePath):
            store_path(one)


class FileSum(NamedTuple):
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


class Files:
    """Files of a folder of this machine, which is made when the first one is written; `ObjectFiles`
    has those of an object storage. Picklable, so that tasks on other machines find them again.

    What reaches for a file raises OSError where that cannot be done, and FileNotFoundError where
    there is none.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    @property
    def name(self) -> str:
        """How people call the place: a path or an address."""
        return str(self.folder)

    def read(self, key: str) -> bytes:
        """All of a file."""
        check_regular(self.folder / key)
        return (self.folder / key).read_bytes()

    def read_small(self, key: str, most: int = MOST_TEXT) -> bytes:
        """All of a file of at most `most` bytes; raises GiantFile for a larger one."""
        size = self.size(key)
        if size is not None and size > most:
            reason = f"it has {size} bytes, which no such file needs"
            raise GiantFile(errno.EFBIG, reason, f"{self.name}/{key}")
        return self.read(key)

    def write(self, key: str, data: bytes, *, safe: bool = False) -> None:
        """Make or replace a file, under another name first.

        Args:
          safe: whether it is safe from a loss of power when this returns.
        """
        target = self.folder / key
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, data, safe=safe)

    def take(self, files: Mapping[str, Path]) -> None:
        """Make or replace files, by key, from some of this machine, which are moved away and safe
        from a loss of power when this returns."""
        sync_all(files.values())
        targets = {self.folder / key: path for key, path in files.items()}
        for target, path in targets.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)
        sync_all({target.parent for target in targets})

    def size(self, key: str) -> int | None:
        """Size [bytes] of a file, None when there is none; raises OddFile for no regular file."""
        try:
            return check_regular(self.folder / key)
        except (FileNotFoundError, NotADirectoryError):
            return None

    def exists(self, key: str) -> bool:
        """Whether anything is there."""
        return (self.folder / key).exists()

    def sum(self, key: str) -> FileSum:
        """Size and hash of a file, read piece by piece."""
        return file_sum(self.folder / key)

    def sizes(self) -> Iterator[tuple[str, int]]:
        """Key and size [bytes] of every file, those of a folder in the order of their names; some
        may go away meanwhile."""
        for path in files_below(self.folder) if self.folder.is_dir() else ():
            with contextlib.suppress(FileNotFoundError):
                yield path.relative_to(self.folder).as_posix(), path.lstat().st_size

    def all_keys(self) -> Iterator[str]:
        """Keys of all files."""
        return (key for key, _ in self.sizes())

    def stored_bytes(self) -> int:
        """Size of all files together."""
        return sum(size for _, size in self.sizes())

    def folders(self) -> list[str]:
        """First parts of the keys that have more than one, sorted."""
        try:
            with os.scandir(self.folder) as entries:
                return sorted(entry.name for entry in entries if entry.is_dir())
        except (FileNotFoundError, NotADirectoryError):
            return []

    def zarr_store(self) -> Any:
        """What zarr and xarray open to read."""
        return str(self.folder)

    def remove(self, key: str) -> None:
        """Remove a file if there is one."""
        (self.folder / key).unlink(missing_ok=True)

    def remove_all(self) -> None:
        """Remove every file as far as that is allowed."""
        shutil.rmtree(self.folder, ignore_errors=True)


def files_at(place: str | StorePath) -> Files:
    """The files of a folder of this machine, or below an address.

    Raises:
      InputError: an address that cannot be used, or obstore is not installed.
    """
    path = store_path(place)
    if isinstance(path, Path):
        return Files(path)
    found: Files = resolve("twin.records.storage.object_storage:ObjectFiles")(path)
    return found
