"""Sharded: write a store of simulated missions shard by shard.

Each mission is one chunk of a signal. A shard packs the chunks of many missions into one file, so
a store of thousands of missions has hundreds of files. Each chunk has a CRC-32C, so any reader
finds damage. The workers that fly missions write shards with `ShardWriter`; one process writes the
rest with `ShardedStore`.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import json
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.schema import MISSION, TIME
from twin.records.storage.checksums import ZARR_LIST, list_text
from twin.records.storage.store_path import Files, FileSum, StorePath

if TYPE_CHECKING:
    import zarr
    from zarr.abc.store import Store

    AnyStore: TypeAlias = Store

COMPRESSOR: Literal["zstd"] = "zstd"
LEVEL = 1
"""Compression level; higher levels take twice the time and save a tenth of the size."""
DTYPE = np.dtype("<f4")
"""Stored type of signals"""
BESIDE = "coordinates"
"""CF attribute with the names of the arrays that xarray makes coordinates"""
METADATA = "zarr.json"
NO_CHUNK = 2**64 - 1
"""Entry in a shard's index for a mission that the store does not have"""
PYTHON_PIPELINE = "zarr.core.codec_pipeline.BatchedCodecPipeline"
RUST_PIPELINE = "zarrs.ZarrsCodecPipeline"
_MEMBERS = (
    *("zarr_format", "node_type", "shape", "data_type", "chunk_grid", "chunk_key_encoding"),
    *("fill_value", "codecs", "dimension_names", "attributes", "storage_transformers"),
)
"""Order of the members in an array's metadata file; runs identify a store by its files' bytes."""


def load_zarr() -> None:
    """Import zarr ahead of its first use; the import takes 0.1 s."""
    import zarr  # noqa: F401


def stored_values(values: NDArray[np.float64], decimals: int | None) -> NDArray[np.float32]:
    """Round `values` for bulk stores: float32, in binary steps of at most 10**-decimals.

    A binary step leaves zero bits at the end of every number, which compress well.
    """
    if decimals is None:
        return values.astype(DTYPE)
    scale = 2.0 ** math.ceil(decimals * math.log2(10.0))
    return (np.rint(values * scale) / scale).astype(DTYPE)


def fill_value(dtype: np.dtype[Any]) -> Any:
    """Return the value for missing data: NaN, the lowest int64, an empty text, or 0."""
    if dtype.kind in "fT":
        return np.nan if dtype.kind == "f" else ""
    return np.iinfo(dtype).min if dtype == np.dtype("<i8") else 0


def flag_attributes(long_name: str, meanings: Sequence[str], first: int = 0) -> dict[str, Any]:
    """Return the CF attributes of an integer array whose values stand for `meanings`."""
    return {
        "long_name": long_name,
        "flag_values": list(range(first, first + len(meanings))),
        "flag_meanings": " ".join(meanings),
    }


class ShardWriter:
    """Writer of one shard: a file for each signal in a local folder; a context manager.

    Each mission is encoded when it is added, so memory does not grow with the shard. The files have
    the bytes that zarr-python would write, which tests compare: the encoded chunks in a row, then
    an index with the offset and size of each chunk. Chunks and index have a CRC-32C each.
    """

    def __init__(self, folder: Path, *, missions: int, samples: int):
        """`missions` is the number in a full shard, `samples` the length of the longest mission."""
        import numcodecs

        self.folder, self.missions, self.samples = folder, missions, samples
        self._rows = 0
        self._opened = contextlib.ExitStack()
        self._signals: dict[str, _SignalFile] = {}
        # with threads, the order of the blocks in a chunk would be random
        self._opened.callback(setattr, numcodecs.blosc, "use_threads", numcodecs.blosc.use_threads)
        numcodecs.blosc.use_threads = False
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()

    def add(self, signals: Mapping[str, NDArray[Any]]) -> None:
        """Encode one mission: pad its signals, and fill missing signals; raises OSError."""
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
        """Write the indices; returns the checksum of each signal's file. Raises OSError."""
        found = {name: one.finish(self.missions) for name, one in self._signals.items()}
        self._opened.close()
        return found


class _SignalFile:
    """File of one signal in a shard."""

    def __init__(self, file: BinaryIO, samples: int, dtype: np.dtype[Any]):
        import numcodecs
        from numcodecs.checksum32 import CRC32C

        self.file, self.dtype = file, dtype
        shuffle = numcodecs.Blosc.SHUFFLE
        self._blosc = numcodecs.Blosc(cname=COMPRESSOR, clevel=LEVEL, shuffle=shuffle)
        self._checksum = CRC32C(location="end")
        self._row: NDArray[Any] = np.empty(samples, dtype)
        self._digest, self._size = hashlib.sha256(), 0
        self._index: list[tuple[int, int]] = []

    def add(self, values: NDArray[Any]) -> None:
        self._row[: len(values)] = values
        self._row[len(values) :] = fill_value(self.dtype)
        start = self._size
        self._write(self._blosc.encode(self._row))
        self._index.append((start, self._size - start))

    def finish(self, missions: int) -> FileSum:
        index = np.full((missions, 2), NO_CHUNK, "<u8")
        index[: len(self._index)] = self._index
        self._write(index.tobytes())
        return FileSum(self._size, self._digest.hexdigest())

    def _write(self, data: bytes) -> None:
        checked = self._checksum.encode(data)
        self.file.write(checked)
        self._digest.update(checked)
        self._size += len(checked)


class ShardedStore:
    """Writer of all parts of a store except its shards: arrays over missions, groups, metadata and
    checksums. The store is complete when `finish` has written its `zarr.json`."""

    def __init__(
        self, files: Files, *, missions: int, samples: int, shard_missions: int, row_missions: int
    ):
        """Describe the store.

        Args:
          samples: number of samples of the longest mission.
          shard_missions: missions in each shard of a signal.
          row_missions: missions in each chunk of an array that is no signal.
        """
        self.files, self.missions, self.samples = files, missions, samples
        self.shard_missions, self.row_missions = shard_missions, row_missions
        self.sums: dict[str, FileSum] = {}
        """Checksums of all written files, by key; the caller adds those of the shards."""
        self._metadata: dict[str, Any] = {}
        # cached, because many arrays differ only in their values and making one takes milliseconds
        self._alike = functools.cache(self._rows)

    def write_rows(
        self,
        name: str,
        dimensions: tuple[str, ...],
        values: NDArray[Any],
        attributes: Mapping[str, Any],
    ) -> None:
        """Write an array that is no signal."""
        import zarr

        # zarr's own pipeline encodes, whatever the environment sets
        with zarr.config.set({"codec_pipeline.path": PYTHON_PIPELINE}):
            memory, array = self._alike(values.shape, values.dtype, dimensions)
            array[:] = values
        for chunk in [key for key in memory if key != METADATA]:
            self._put(f"{name}/{chunk}", memory.pop(chunk).to_bytes())
        self._metadata[name] = _document(array, attributes)

    def write_group(self, name: str, attributes: Mapping[str, Any]) -> None:
        """Write a group that holds only attributes."""
        self._put(f"{name}/{METADATA}", _compact(_group(attributes)))

    def _put(self, key: str, data: bytes) -> None:
        """Write a file and keep its checksum."""
        self.files.write(key, data)
        self.sums[key] = FileSum(len(data), hashlib.sha256(data).hexdigest())

    def finish(
        self,
        signals: Mapping[str, tuple[np.dtype[Any], Mapping[str, Any]]],
        attributes: Mapping[str, Any],
    ) -> None:
        """Write all metadata, the list of checksums and at last the metadata of the store, which
        completes it.

        Args:
          signals: type and attributes of each array over mission and time, by name.
          attributes: attributes of the store.
        """
        like = {dtype: self._signal(dtype) for dtype in {dtype for dtype, _ in signals.values()}}
        for name, (dtype, said) in signals.items():
            self._metadata[name] = _document(like[dtype], said)
        for name, document in self._metadata.items():
            self._put(f"{name}/{METADATA}", _compact(document))
        table = {"kind": "inline", "must_understand": False, "metadata": self._metadata}
        group = _group({**SIMULATED_ATTRIBUTES, **attributes}) | {"consolidated_metadata": table}
        root = _compact(group)
        self.sums[METADATA] = FileSum(len(root), hashlib.sha256(root).hexdigest())
        self.files.write(ZARR_LIST, list_text(self.sums, zarr=True))
        self.files.write(METADATA, root)

    def _signal(self, dtype: np.dtype[Any]) -> zarr.Array[Any]:
        """Make an array (mission, time) in memory, for its metadata."""
        import zarr
        from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec

        blosc = BloscCodec(
            typesize=dtype.itemsize, cname=COMPRESSOR, clevel=LEVEL, shuffle="shuffle", blocksize=0
        )
        return zarr.create_array(
            {},
            shape=(self.missions, self.samples),
            shards=(self.shard_missions, self.samples),
            chunks=(1, self.samples),
            dtype=dtype,
            fill_value=fill_value(dtype),
            serializer=BytesCodec(),
            compressors=[blosc, Crc32cCodec()],
            dimension_names=(MISSION, TIME),
        )

    def _rows(
        self, shape: tuple[int, ...], dtype: np.dtype[Any], dimensions: tuple[str, ...]
    ) -> tuple[dict[str, Any], zarr.Array[Any]]:
        """Make an array with uncompressed chunks in memory; returns the memory and the array."""
        import zarr
        from zarr.codecs import BytesCodec, Crc32cCodec

        memory: dict[str, Any] = {}
        rows = self.row_missions if dimensions[0] == MISSION else shape[0]
        return memory, zarr.create_array(
            memory,
            shape=shape,
            chunks=(min(rows, shape[0]), *shape[1:]),
            dtype=dtype,
            fill_value=fill_value(dtype),
            serializer="auto" if dtype.kind == "T" else BytesCodec(),
            compressors=[Crc32cCodec()],
            dimension_names=dimensions,
            config={"write_empty_chunks": True},
        )


def _document(array: zarr.Array[Any], attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Metadata for the file of an array with the layout of `array` and other attributes."""
    found: dict[str, Any] = {**array.metadata.to_dict(), "attributes": dict(attributes)}
    return {member: found.get(member, []) for member in _MEMBERS}


def _group(attributes: Mapping[str, Any]) -> dict[str, Any]:
    return {"zarr_format": 3, "node_type": "group", "attributes": attributes}


def _compact(value: Mapping[str, Any]) -> bytes:
    """Format JSON without white space, because small stores are mostly metadata."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()


def check_empty(store: AnyStore) -> None:
    """Raise StoreError unless a zarr store is empty and open for writing."""
    import asyncio

    if store.read_only:
        raise StoreError(f"{store} is read-only: open it for writing")
    if not asyncio.run(store.is_empty("")):
        raise StoreError(f"{store} holds something already: missions go into an empty store")


def copy_into(files: Files, store: AnyStore) -> None:
    """Copy all files into a zarr store: the metadata of the store first, then that of its arrays,
    then chunks, because some stores require this order."""
    import asyncio

    from zarr.core.buffer import default_buffer_prototype

    buffer = default_buffer_prototype().buffer

    def place(key: str) -> tuple[bool, int, str]:
        return not key.endswith(METADATA), key.count("/"), key

    async def copy() -> None:
        for key in sorted(files.all_keys(), key=place):
            await store.set(key, buffer.from_bytes(files.read(key)))

    asyncio.run(copy())


def fast_pipeline() -> str:
    """Return the codec pipeline for reading: `zarrs` if installed, else zarr-python's own."""
    return PYTHON_PIPELINE if importlib.util.find_spec("zarrs") is None else RUST_PIPELINE


@contextlib.contextmanager
def fast_reading(store: StorePath) -> Iterator[None]:
    """Decode arrays that the context opens with the fast pipeline, in a third of the time; the
    fast pipeline reads folders of this machine only."""
    import zarr

    path = fast_pipeline() if isinstance(store, Path) else PYTHON_PIPELINE
    with zarr.config.set({"codec_pipeline.path": path}), warnings.catch_warnings():
        # zarrs warns of text arrays from other programs, which the slow pipeline then reads
        for text in ("Array is unsupported by Zarrs", ".*does not have a Zarr V3 specification"):
            warnings.filterwarnings("ignore", text)
        yield
