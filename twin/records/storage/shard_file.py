"""Shard file: the signals of the missions of one shard, encoded as they come.

Memory does not grow with the shard. The bytes are those that zarr-python writes: encoded chunks one
after the other, then offset and size of each, each with a CRC-32C. The tests compare them.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Self

import numcodecs
import numpy as np
from numcodecs.checksum32 import CRC32C
from numpy.typing import NDArray

from twin.records.storage.sharded import COMPRESSOR, LEVEL, fill_value
from twin.records.storage.stored_files import FileSum

BLOSC = numcodecs.Blosc(cname=COMPRESSOR, clevel=LEVEL, shuffle=numcodecs.Blosc.SHUFFLE)
CHECKSUM = CRC32C(location="end")
NO_CHUNK = 2**64 - 1
"""Stands in a shard's index for a mission that the store does not have"""


class ShardWriter:
    """Signals of the missions of one shard, a file of each in a folder of this machine; a context
    manager that closes them.

    A file has the encoded chunks one after the other, then offset and size of each, as the sharding
    of zarr lays them out.
    """

    def __init__(self, folder: Path, *, missions: int, samples: int):
        """`missions` of a full shard; `samples` of the longest mission of the store."""
        self.folder, self.missions, self.samples = folder, missions, samples
        self._rows = 0
        self._opened = contextlib.ExitStack()
        self._signals: dict[str, _SignalFile] = {}
        folder.mkdir(parents=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()

    def add(self, signals: Mapping[str, NDArray[Any]]) -> None:
        """Encode one mission, whose signals are padded, and missing ones filled; raises OSError."""
        for name, values in signals.items():
            if name not in self._signals:
                file = self._opened.enter_context((self.folder / name).open("wb"))
                one = self._signals[name] = _SignalFile(file, self.samples, values.dtype)
                for _ in range(self._rows):
                    one.add(values[:0])
        for name, one in self._signals.items():
            one.add(signals.get(name, np.zeros(0, one.dtype)))
        self._rows += 1

    def finish(self) -> dict[str, FileSum]:
        """Write the indices; the checksum of each signal's file. Raises OSError."""
        found = {name: one.finish(self.missions) for name, one in self._signals.items()}
        self._opened.close()
        return found


class _SignalFile:
    """One signal of a shard."""

    def __init__(self, file: BinaryIO, samples: int, dtype: np.dtype[Any]):
        self.file, self.dtype = file, dtype
        self._row: NDArray[Any] = np.empty(samples, dtype)
        self._digest, self._size = hashlib.sha256(), 0
        self._index: list[tuple[int, int]] = []

    def add(self, values: NDArray[Any]) -> None:
        self._row[: len(values)] = values
        self._row[len(values) :] = fill_value(self.dtype)
        start = self._size
        self._write(BLOSC.encode(self._row))
        self._index.append((start, self._size - start))

    def finish(self, missions: int) -> FileSum:
        index = np.full((missions, 2), NO_CHUNK, "<u8")
        index[: len(self._index)] = self._index
        self._write(index.tobytes())
        return FileSum(self._size, self._digest.hexdigest())

    def _write(self, data: bytes) -> None:
        checked = CHECKSUM.encode(data)
        self.file.write(checked)
        self._digest.update(checked)
        self._size += len(checked)
