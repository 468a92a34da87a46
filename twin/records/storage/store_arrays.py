"""Store arrays: what is read from an open store, with errors that say what of it is damaged.

A store's files are also copied from here into any zarr store that a program has opened.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from twin.errors import StoreError
from twin.records.attributes import N_SAMPLES
from twin.records.schema import TIME
from twin.records.storage.object_storage import files_at
from twin.records.storage.sharded import METADATA
from twin.records.storage.store_path import StorePath
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
    """Raise StoreError that names the first of `gone_arrays`, when there is one."""
    for name in gone_arrays(dataset, path)[:1]:
        raise StoreError(f"store {path} is damaged: its array {name} is gone; make it again")


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
        raise StoreError(f"store {path} is damaged: its array {name} is gone; make it again")
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
