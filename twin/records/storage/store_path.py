"""Store path: where a store lies, a path of this machine or the address of an object storage."""

from __future__ import annotations

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


def store_path(place: str | PurePath) -> StorePath:
    """The path or address that a text means. A `Path` made of an address is taken for it.

    Raises:
      InputError: an address of a kind that nobody can read, or one that names no store.
    """
    if isinstance(place, Path | Url) and place.parts[:1] not in [(f"{s}:",) for s in SCHEMES]:
        return place
    text = str(place) if MARK in str(place) else str(place).replace(":/", MARK, 1)
    scheme, mark, rest = text.partition(MARK)
    if not mark:
        return Path(place)
    if scheme not in SCHEMES:
        raise InputError(
            f"{place}: {unknown_name('kind of address', scheme, SCHEMES)}; without {MARK} it is "
            "a path of this machine"
        )
    if len(Url(text).parts) < 3 or ".." in rest.split("/"):
        raise InputError(
            f"{place} names no store: give the bucket and a name in it, such as "
            f"{scheme}{MARK}BUCKET/missions.zarr"
        )
    return Url(text)
