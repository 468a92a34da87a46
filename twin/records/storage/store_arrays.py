"""Store arrays: what is read from an open store, with errors that say what of it is damaged.

A store's files are also copied from here into any zarr store that a program has opened.
"""

from __future__ import annotations

import asyncio
import itertools
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from twin.errors import StoreError, quoted
from twin.records.attributes import N_SAMPLES
from twin.records.schema import TIME
from twin.records.storage.checksums import has_checksums, read_checksums
from twin.records.storage.object_storage import files_at
from twin.records.storage.sharded import METADATA
from twin.records.storage.store_path import StorePath, store_path
from twin.records.storage.stored_files import Files

if TYPE_CHECKING:
    import xarray as xr
    from zarr.abc.store import Store

    AnyStore: TypeAlias = Store


def check_mission(mission: int, count: int, what: str) -> None:
    """Raise StoreError when there is no such mission among `count`, or none at all.

    Args:
      what: the store or file, for the error.
    """
    check_filled(count, what)
    if not 0 <= mission < count:
        raise StoreError(f"{what} has missions 0 to {count - 1}, not {mission}")


def check_filled(count: int, what: str) -> None:
    """Raise StoreError when `count`, the missions of a store or file, is zero."""
    if count == 0:
        raise StoreError(f"{what} holds no missions; make some with `factory generate`")


def gone_arrays(dataset: xr.Dataset, path: str | StorePath) -> list[str]:
    """Arrays that the store's metadata name and whose files are gone: they would read as NaN.

    Args:
      dataset: as `open_store` gave it.
    """
    files = files_at(path)
    return [name for name in map(str, dataset.variables) if not files.exists(f"{name}/{METADATA}")]


def check_arrays(dataset: xr.Dataset, path: str | StorePath) -> None:
    """Raise StoreError that names the first of `gone_arrays`, or of the files of their chunks."""
    for name in gone_arrays(dataset, path)[:1]:
        raise _gone(name, path)
    for name in map(str, dataset.variables):
        check_chunks(dataset, name, path)


def check_chunks(dataset: xr.Dataset, name: str, path: str | StorePath) -> None:
    """Raise StoreError when a file of an array is gone: zarr reads it as missing values.

    A chunk without a value has no file, and the store's list of checksums does not name it. The
    list is read only where a file is not there. Stores without a list, and those in an object
    storage, where each question is a request, are taken as they are.

    Args:
      dataset: all missions, as `open_store` gave it.
    """
    place, variable = store_path(path), dataset.variables[name]
    chunks = variable.encoding.get("shards") or variable.encoding.get("chunks")
    if not isinstance(place, Path) or chunks is None:
        return
    files = files_at(place)
    if not files.exists(f"{name}/{METADATA}"):
        raise _gone(name, path)
    grid = (range(-(-n // size)) for n, size in zip(variable.shape, chunks, strict=True))
    keys = ("/".join((name, "c", *map(str, cell))) for cell in itertools.product(*grid))
    absent = [key for key in keys if not files.exists(key)]
    if not absent or not has_checksums(place):
        return
    listed = read_checksums(place)
    gone = [key for key in absent if key in listed]
    if gone:
        more = f" and {len(gone) - 1} more of" if len(gone) > 1 else " of"
        raise StoreError(
            f"store {path} is damaged: file {gone[0]}{more} its array {name} is gone, and would "
            f"read as missing values; `factory verify {quoted(path)}` names all damage: bring the "
            "files back from a copy or make the store again"
        )


def _gone(name: str, path: str | StorePath) -> StoreError:
    return StoreError(f"store {path} is damaged: its array {name} is gone; make it again")


def mission_samples(one: xr.Dataset, path: str | StorePath, mission: int) -> int:
    """The number of samples of a mission, which must fit the store's arrays."""
    if N_SAMPLES not in one:
        raise StoreError(f"store {path} is damaged: it has no array {N_SAMPLES}")
    samples = int(np.nan_to_num(read_array(one, N_SAMPLES, path), nan=0.0))
    if not 0 < samples <= one.sizes[TIME]:
        raise StoreError(
            f"store {path} is damaged: mission {mission} has {samples} of at most "
            f"{one.sizes[TIME]} samples"
        )
    return samples


def read_array(dataset: xr.Dataset, name: str, path: str | StorePath) -> np.ndarray:
    """An array of a store that `open_store` opened, or of some of its missions.

    Raises:
      StoreError: its files are gone or cannot be decoded.
    """
    if not files_at(path).exists(f"{name}/{METADATA}"):
        raise _gone(name, path)
    try:
        return np.asarray(dataset[name].values)
    except Exception as error:  # whatever a decoder raises means damaged files
        why = " ".join(str(error).split()) or type(error).__name__
        raise StoreError(
            f"store {path} is damaged: its array {name} cannot be read ({why}); make it again, or "
            "bring back its files from a copy"
        ) from error


def check_empty(store: AnyStore) -> None:
    """Raise StoreError unless a store is empty and open for writing."""
    if store.read_only:
        raise StoreError(f"{store} is read-only: open it for writing")
    if not asyncio.run(store.is_empty("")):
        raise StoreError(f"{store} holds something already: missions go into an empty store")


def copy_into(files: Files, store: AnyStore) -> None:
    """Copy all keys: metadata of an array before its chunks, which some stores ask for, and those
    of the whole first of all."""
    asyncio.run(_copy(files, store))


async def _copy(files: Files, store: AnyStore) -> None:
    from zarr.core.buffer import default_buffer_prototype

    buffer = default_buffer_prototype().buffer

    def place(key: str) -> tuple[bool, int, str]:
        return not key.endswith(METADATA), key.count("/"), key

    for key in sorted(files.all_keys(), key=place):
        await store.set(key, buffer.from_bytes(files.read(key)))
