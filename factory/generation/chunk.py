"""Chunk: one signal of one mission as the bytes that a store holds."""

from __future__ import annotations

import math
import struct

import google_crc32c
import numpy as np
from numcodecs import blosc  # type: ignore[import-untyped]
from numpy.typing import NDArray

from factory.generation.store_layout import COMPRESSOR, DTYPE, LEVEL

# the same bytes whoever compresses: blosc splits blocks by size, not by threads, but its own
# threads would compete with the worker processes
blosc.set_nthreads(1)


def stored_values(values: NDArray[np.float64], decimals: int | None) -> NDArray[np.float32]:
    """`values` as stores keep them: float32, rounded to a binary step below 10**-decimals.

    A binary step leaves zero bits at the end of every number, which compress away.
    """
    if decimals is None:
        return values.astype(DTYPE)
    scale = 2.0 ** math.ceil(decimals * math.log2(10.0))
    return (np.rint(values * scale) / scale).astype(DTYPE)


def encode(values: NDArray[np.float32], samples: int) -> bytes:
    """The chunk of one mission: padded with NaN to `samples`, compressed, with its checksum."""
    padded = np.full(samples, np.nan, DTYPE)
    padded[: len(values)] = values
    compressed: bytes = blosc.compress(padded, COMPRESSOR.encode(), LEVEL, blosc.SHUFFLE)
    return compressed + checksum(compressed)


def checksum(data: bytes) -> bytes:
    """CRC-32C as zarr's codec of that name appends it."""
    return struct.pack("<I", google_crc32c.value(data))


def shard(chunks: list[bytes | None]) -> bytes:
    """Chunks packed into one file: zarr's `sharding_indexed` with the index at the end.

    None leaves a chunk out; readers then see the fill value.
    """
    missing = 2**64 - 1
    index, offset = [], 0
    for chunk in chunks:
        index.append((missing, missing) if chunk is None else (offset, len(chunk)))
        offset += 0 if chunk is None else len(chunk)
    table = np.array(index, "<u8").tobytes()
    return b"".join(chunk for chunk in chunks if chunk is not None) + table + checksum(table)
