"""Store path: where a store lies, a path of this machine or the address of an object storage."""

from __future__ import annotations

import re
from pathlib import Path, PurePath, PurePosixPath
from typing import NoReturn, TypeAlias

from twin.errors import InputError, unknown_name

SCHEMES = {"s3": "Amazon S3 and what speaks like it", "gs": "Google Cloud", "az": "Azure"}
"""What may stand before :// in an address, and whose it is"""
MARK = "://"


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


_ADDRESS = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):(?:/+(.*))?", re.DOTALL)
"""An address, with both slashes or with the one that a path makes of them"""


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
