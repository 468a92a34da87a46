"""Checksums: a list of every file of a folder with its size and SHA-256, so that damage is found.

A plain folder has the list as `checksums.json`. In a zarr store it is the attributes of a group of
that name, `checksums/zarr.json`: zarr warns of every entry of a group, hidden ones too, that is no
part of a hierarchy. Both say the same:

    {"files": {"time/zarr.json": {"bytes": 512, "sha256": "..."}}, "digest": "..."}

`digest` is the SHA-256 of the canonical text of `files`. The list is compared with the only text
that its content can have, so that a changed byte is found anywhere in it too.

Content: hashes of stores, by which runs and calibrations know what they were made from.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal, NamedTuple

from twin.bounded import FREE_BYTES, check_regular, regular_files
from twin.errors import StoreError
from twin.records.attributes import N_SAMPLES, SPLIT
from twin.records.schema import TIME
from twin.records.storage.disk import write_whole
from twin.records.storage.store_path import (
    Files,
    FileSum,
    StorePath,
    file_sum,
    files_at,
    store_path,
)

LIST = "checksums.json"
"""The list of a plain folder."""
ZARR_METADATA = "zarr.json"
ZARR_LIST = f"checksums/{ZARR_METADATA}"
"""The list of a zarr store."""

MOST_LIST = 2**30
"""[byte] of a list; a store of a million missions has one of some megabytes"""
FILES_AT_ONCE = 1000
"""That wait for the threads that read them"""


class Damage(NamedTuple):
    """One file that is not what the list says."""

    path: str
    """relative to the folder, with slashes"""
    what: Literal["changed", "missing", "unknown", "unreadable"]
    """`unknown` are files that the list does not name"""
    detail: str = ""

    def __str__(self) -> str:
        """In words, for people."""
        return f"{self.path} is {self.what}{f': {self.detail}' if self.detail else ''}"


def has_checksums(folder: str | StorePath) -> bool:
    """Whether a folder has a list; nothing of it is read."""
    return _list_of(files_at(folder)) is not None


def is_listed(folder: str | StorePath) -> bool:
    """Whether a folder has a list that names every file in it: nothing there is a user's own."""
    try:
        sums = read_checksums(folder)
    except StoreError:
        return False
    return all(name in sums for name in _names(files_at(folder)))


def write_checksums(folder: str | Path) -> Path:
    """Write the list of all files that a folder holds now; returns its path.

    Raises:
      OSError: a file cannot be read, or the list not be written.
    """
    root = Path(folder)
    target = root / (ZARR_LIST if (root / ZARR_METADATA).is_file() else LIST)
    sums = {name: file_sum(root / name) for name in _names(Files(root))}
    target.parent.mkdir(exist_ok=True)
    write_whole(target, list_text(sums, zarr=target.name == ZARR_METADATA))
    return target


def read_checksums(folder: str | StorePath) -> dict[str, FileSum]:
    """The list of a folder, by paths relative to it.

    Raises:
      StoreError: there is none, or it is damaged itself.
    """
    files = files_at(folder)
    key = _list_of(files)
    if key is None:
        raise StoreError(f"{folder} has no list of checksums ({LIST} or {ZARR_LIST})")
    place = f"{files.name}/{key}"
    try:
        data = files.read_small(key, MOST_LIST)
        document: Any = json.loads(data)
        table = document["attributes"] if key == ZARR_LIST else document
        sums = {
            str(name): FileSum(int(entry["bytes"]), str(entry["sha256"]))
            for name, entry in table["files"].items()
        }
        whole = data == list_text(sums, zarr=key == ZARR_LIST)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        why = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise StoreError(f"the list of checksums {place} is damaged ({why})") from error
    if not whole:
        why = "it does not have its own digest"
        raise StoreError(f"the list of checksums {place} is damaged: {why}")
    return sums


def check_readable(folder: str | StorePath) -> None:
    """Raise before a file, or a file of a store, is opened that no reader comes to the end of.

    Each must be a regular file. A large one must have the size that the list says, where it names
    it, or else no more bytes than the values of all arrays; smaller ones, which cannot fill a
    memory, are left to whoever reads them. Objects of a storage are what it lists.

    Raises:
      StoreError: names the first file that is not so.
    """
    place = store_path(folder)
    if not isinstance(place, Path):
        return
    try:
        if not place.is_dir():
            check_regular(place)
            return
        large = {name: size for name, size in regular_files(place) if size > FREE_BYTES}
        if not large:
            return
        sums = read_checksums(place) if has_checksums(place) else {}
        for name, size in large.items():
            most = sums[name].bytes if name in sums else _declared(place)
            if size > most:
                raise StoreError(
                    f"{folder} is damaged: its file {name} has {size} bytes, and "
                    f"{most} are the most that it can have; bring it back from a copy"
                )
    except OSError as error:
        raise StoreError(
            f"{folder} cannot be read: {error.filename}: {error.strerror}; bring it back from a "
            "copy"
        ) from error


def _declared(store: Path) -> int:
    """Bytes that the arrays of a zarr store have in memory; nothing of them is read."""
    import zarr

    try:
        return sum(array.nbytes for _, array in zarr.open_group(store, mode="r").arrays())
    except Exception:  # no group at all: then nothing in it is an array
        return FREE_BYTES


def damaged_files(
    folder: str | StorePath, only: Iterable[str] | None = None, *, workers: int = 1
) -> Iterator[Damage]:
    """Every file of a folder that is not what its list says, in the order of the list.

    Args:
      workers: files that are read at a time, in threads: hashing lets others run.
      only: files, or folders with all that is in them, relative to the folder; None: everything,
        which also finds files that the list does not name.

    Raises:
      StoreError: the folder has no list.
    """
    files = files_at(folder)
    try:
        sums = read_checksums(folder)
    except StoreError as error:
        key = _list_of(files)
        if key is None:
            raise
        yield Damage(key, "changed", str(error))
        return

    def compare(name: str) -> Damage | None:
        size, expected = sums[name].bytes, sums[name]
        try:
            found = files.size(name)
            if found is None:
                return Damage(name, "missing")
            if found != size:  # what was cut need not be read
                return Damage(name, "changed", f"{found} bytes instead of {size}")
            if files.sum(name) != expected:
                return Damage(name, "changed", "its SHA-256 is another one")
        except OSError as error:
            return Damage(name, "unreadable", error.strerror or str(error))
        return None

    chosen = None if only is None else {f"{one}/" for one in only}
    asked = [n for n in sums if chosen is None or any(f"{n}/".startswith(one) for one in chosen)]
    with ThreadPoolExecutor(workers) as pool:
        for first in range(0, len(asked), FILES_AT_ONCE):
            yield from filter(None, pool.map(compare, asked[first : first + FILES_AT_ONCE]))
    if chosen is None:
        yield from (Damage(name, "unknown") for name in _names(files) if name not in sums)


def _list_of(files: Files) -> str | None:
    """Which list a folder has."""
    return next((key for key in (ZARR_LIST, LIST) if files.exists(key)), None)


def _names(files: Files) -> Iterator[str]:
    """All files but the list itself."""
    return (key for key in files.all_keys() if key not in (LIST, ZARR_LIST))


def list_text(sums: Mapping[str, FileSum], *, zarr: bool) -> bytes:
    """The only text that a list of these sums can have."""
    files = {name: {"bytes": one.bytes, "sha256": one.sha256} for name, one in sums.items()}
    digest = hashlib.sha256(_json(files)).hexdigest()
    table = {"digest": digest, "files": files}
    return _json({"attributes": table, "node_type": "group", "zarr_format": 3} if zarr else table)


def _json(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":")).encode()


def array_checksums(store: Path) -> dict[str, str]:
    """SHA-256 over type, shape and values of each array of a zarr store, by name.

    Values count, not files: another version of the compression leaves the checksums as they are.
    """
    import numpy as np
    import xarray as xr

    with xr.open_zarr(store, decode_times=False) as data:
        return {
            str(name): hashlib.sha256(
                f"{array.dtype.str}{array.shape}".encode()
                + np.ascontiguousarray(array.values).tobytes()
            ).hexdigest()
            for name, array in sorted(data.variables.items(), key=lambda item: str(item[0]))
        }


def store_hash(store: str | StorePath) -> str:
    """SHA-256 over the names and bytes of all files of a store that are not hidden."""
    return _hash({"": files_at(store)})


def content_hash(store: str | StorePath, names: Iterable[str]) -> str:
    """SHA-256 over names and bytes of the files of these arrays: what a training learned from.

    The store's own attributes are left out: they say when it was made, and the same recipe makes
    the same arrays again.
    """
    root = store_path(store)
    wanted = sorted({TIME, N_SAMPLES, SPLIT, *names})
    return _hash({f"{name}/": files_at(root / name) for name in wanted})


def _hash(places: Mapping[str, Files]) -> str:
    """SHA-256 over keys and bytes of the files of places by prefix, in the order of paths, without
    the hidden ones: what a killed writer left is no content."""
    digest = hashlib.sha256()
    for prefix, files in places.items():
        keys = (key for key in files.all_keys() if not key.rpartition("/")[2].startswith("."))
        for key in sorted(keys, key=lambda key: key.split("/")):
            digest.update(f"{prefix}{key}".encode())
            digest.update(files.read(key))
    return digest.hexdigest()
