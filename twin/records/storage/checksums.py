"""Checksums: a list of a folder's files with sizes and SHA-256, which shows damage.

A plain folder keeps the list as `checksums.json`. A zarr store keeps the list as attributes of a
group, `checksums/zarr.json`, because zarr warns of every file that is no part of the hierarchy.
Both have the same content:

    {"files": {"time/zarr.json": {"bytes": 512, "sha256": "..."}}, "digest": "..."}

`digest` is the SHA-256 of the canonical text of `files`. A list has only one possible text, so a
changed byte in the list is found too.

Hashes of stores (`store_hash`, `content_hash`) identify the data of runs and calibrations.
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
"""File with the list of a plain folder"""
ZARR_METADATA = "zarr.json"
ZARR_LIST = f"checksums/{ZARR_METADATA}"
"""File with the list of a zarr store"""

MOST_LIST = 2**30
"""[byte] Largest list that is read; the list of a million missions has some megabytes."""
FILES_AT_ONCE = 1000
"""Number of files that are queued for the reading threads at a time"""


class Damage(NamedTuple):
    """File that differs from the list."""

    path: str
    """Path relative to the folder, with slashes"""
    what: Literal["changed", "missing", "unknown", "unreadable"]
    """Type of damage; `unknown` is a file that the list does not name"""
    detail: str = ""

    def __str__(self) -> str:
        """Describe the damage in words."""
        return f"{self.path} is {self.what}{f': {self.detail}' if self.detail else ''}"


def has_checksums(folder: str | StorePath) -> bool:
    """Return whether a folder has a list, without reading it."""
    return _list_key(files_at(folder)) is not None


def is_listed(folder: str | StorePath) -> bool:
    """Return whether a folder's list names every file in it, so that no file is the user's own."""
    try:
        sums = read_checksums(folder)
    except StoreError:
        return False
    return all(name in sums for name in _file_keys(files_at(folder)))


def write_checksums(folder: str | Path) -> Path:
    """Write the list of all files in a folder; returns the path of the list.

    Raises:
      OSError: a file cannot be read, or the list cannot be written.
    """
    root = Path(folder)
    target = root / (ZARR_LIST if (root / ZARR_METADATA).is_file() else LIST)
    sums = {name: file_sum(root / name) for name in _file_keys(Files(root))}
    target.parent.mkdir(exist_ok=True)
    write_whole(target, list_text(sums, zarr=target.name == ZARR_METADATA))
    return target


def read_checksums(folder: str | StorePath) -> dict[str, FileSum]:
    """Read the list of a folder, by paths relative to the folder.

    Raises:
      StoreError: the folder has no list, or the list is damaged.
    """
    files = files_at(folder)
    key = _list_key(files)
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
    """Refuse a file or store with an endless or oversized file, before a reader opens it.

    Each file must be regular. A large file must not exceed its size in the list; without an entry
    in the list, it must not exceed the values of all arrays. Files up to FREE_BYTES cannot fill
    the memory and are not checked. Stores in an object storage are not checked.

    Raises:
      StoreError: names the first file that breaks these rules.
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
            most = sums[name].bytes if name in sums else _declared_bytes(place)
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


def _declared_bytes(store: Path) -> int:
    """Bytes that the arrays of a zarr store would take in memory; reads metadata only."""
    import zarr

    try:
        return sum(array.nbytes for _, array in zarr.open_group(store, mode="r").arrays())
    except Exception:  # no zarr group, so no arrays
        return FREE_BYTES


def damaged_files(
    folder: str | StorePath, only: Iterable[str] | None = None, *, workers: int = 1
) -> Iterator[Damage]:
    """Find every file of a folder that differs from the folder's list, in the order of the list.

    Args:
      workers: number of threads that read files; hashing releases Python's lock.
      only: paths of files or subfolders to check, relative to the folder; None checks everything
        and also finds files that the list does not name.

    Raises:
      StoreError: the folder has no list.
    """
    files = files_at(folder)
    try:
        sums = read_checksums(folder)
    except StoreError as error:
        key = _list_key(files)
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
            if found != size:  # a truncated file need not be read
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
        yield from (Damage(name, "unknown") for name in _file_keys(files) if name not in sums)


def _list_key(files: Files) -> str | None:
    """Key of the list that a folder has; None without a list."""
    return next((key for key in (ZARR_LIST, LIST) if files.exists(key)), None)


def _file_keys(files: Files) -> Iterator[str]:
    """Keys of all files except the list itself."""
    return (key for key in files.all_keys() if key not in (LIST, ZARR_LIST))


def list_text(sums: Mapping[str, FileSum], *, zarr: bool) -> bytes:
    """Return the canonical text of a list: equal sums always give equal bytes."""
    files = {name: {"bytes": one.bytes, "sha256": one.sha256} for name, one in sums.items()}
    digest = hashlib.sha256(_json(files)).hexdigest()
    table = {"digest": digest, "files": files}
    return _json({"attributes": table, "node_type": "group", "zarr_format": 3} if zarr else table)


def _json(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":")).encode()


def array_checksums(store: Path) -> dict[str, str]:
    """Return the SHA-256 over type, shape and values of each array of a zarr store, by name.

    The checksums do not depend on the files, so another compression leaves them unchanged.
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
    """Return the SHA-256 over the names and bytes of all files of a store, except hidden ones."""
    return _hash({"": files_at(store)})


def content_hash(store: str | StorePath, names: Iterable[str]) -> str:
    """Return the SHA-256 over names and bytes of the arrays that a training reads.

    The store's own attributes are left out: they contain the creation time, and stores of one
    recipe have the same arrays.
    """
    root = store_path(store)
    wanted = sorted({TIME, N_SAMPLES, SPLIT, *names})
    return _hash({f"{name}/": files_at(root / name) for name in wanted})


def _hash(places: Mapping[str, Files]) -> str:
    """SHA-256 over keys and bytes of the files in each place, in the order of paths; without
    hidden files, which a killed writer may have left."""
    digest = hashlib.sha256()
    for prefix, files in places.items():
        keys = (key for key in files.all_keys() if not key.rpartition("/")[2].startswith("."))
        for key in sorted(keys, key=lambda key: key.split("/")):
            digest.update(f"{prefix}{key}".encode())
            digest.update(files.read(key))
    return digest.hexdigest()
