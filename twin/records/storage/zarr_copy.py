"""Zarr copy: the files of a store into any zarr store that a program has opened."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, TypeAlias

from twin.errors import StoreError
from twin.records.storage.sharded import METADATA
from twin.records.storage.stored_files import Files

if TYPE_CHECKING:
    from zarr.abc.store import Store

    AnyStore: TypeAlias = Store


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
