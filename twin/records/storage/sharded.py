"""Sharded: a store of simulated missions written shard by shard, through zarr.

One mission is one chunk. Chunks are packed into shards of many missions, so that a store of
thousands of missions has hundreds of files, and each carries a CRC-32C, so that damage is found
wherever it is read. zarr-python writes all of it: with the codec pipeline `zarrs` where that is
installed, else with its own, which gives the same bytes and takes three times as long.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import importlib.util
import json
import math
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.schema import MISSION, TIME
from twin.records.storage.checksums import ZARR_LIST, check_readable, list_text
from twin.records.storage.store_path import StorePath
from twin.records.storage.stored_files import Files, FileSum

if TYPE_CHECKING:
    import zarr

COMPRESSOR: Literal["zstd"] = "zstd"
LEVEL = 1
"""Higher levels cost twice the time and gain a tenth of the size."""
DTYPE = np.dtype("<f4")
"""Of signals"""
BESIDE = "coordinates"
"""CF attribute that names what xarray makes coordinates"""
METADATA = "zarr.json"
TEXT = "T"
"""Kind of numpy's type of strings."""
PYTHON_PIPELINE = "zarr.core.codec_pipeline.BatchedCodecPipeline"
RUST_PIPELINE = "zarrs.ZarrsCodecPipeline"
_MEMBERS = (
    *("zarr_format", "node_type", "shape", "data_type", "chunk_grid", "chunk_key_encoding"),
    *("fill_value", "codecs", "dimension_names", "attributes", "storage_transformers"),
)
"""Order of an array's metadata in its file: runs know their store by the bytes of its files."""


@dataclass(frozen=True)
class ArrayMeta:
    """An array that is not a signal: a coordinate, or one value or a few of each mission."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    dimensions: tuple[str, ...]
    attributes: Mapping[str, Any]


def stored_values(values: NDArray[np.float64], decimals: int | None) -> NDArray[np.float32]:
    """`values` as bulk stores keep them: float32, rounded to a binary step below 10**-decimals.

    A binary step leaves zero bits at the end of every number, which compress away.
    """
    if decimals is None:
        return values.astype(DTYPE)
    scale = 2.0 ** math.ceil(decimals * math.log2(10.0))
    return (np.rint(values * scale) / scale).astype(DTYPE)


class ShardedStore:
    """A store that grows by shards; it is complete when `finish` has written its `zarr.json`.

    Any process can write any shard. `files` takes whole files only: shards are encoded in
    `staging`, a folder of this machine, of the same file system where `files` are local.
    """

    def __init__(
        self,
        files: Files,
        *,
        missions: int,
        samples: int,
        shard_missions: int,
        row_missions: int,
        staging: Path,
    ):
        """Describe the store.

        Args:
          samples: of the longest mission.
          shard_missions: missions in each shard of a signal.
          row_missions: missions in each chunk of an array that is no signal.
        """
        self.files, self.missions, self.samples = files, missions, samples
        self.shard_missions, self.row_missions = shard_missions, row_missions
        self._staging = staging
        self._staged: dict[tuple[str, np.dtype[Any]], zarr.Array[Any]] = {}
        self._alike: dict[Any, tuple[dict[str, Any], zarr.Array[Any]]] = {}

    def prepare(self) -> None:
        """Get zarr ready, which takes a tenth of a second; `write_shard` else does it itself."""
        self._stage(fast_pipeline(), DTYPE)

    def close(self) -> None:
        """Remove the staging folder."""
        shutil.rmtree(self._staging, ignore_errors=True)

    def write_shard(self, number: int, name: str, block: NDArray[Any]) -> tuple[str, FileSum]:
        """Write shard `number` of a signal; its key and checksum.

        Args:
          block: (missions of the shard, samples), padded with the fill value of its type.

        Raises:
          OSError: the disk refuses.
        """
        first = number * self.shard_missions
        # zarrs leaves out a chunk of nothing but the fill value, zarr-python keeps it as asked
        empty = np.isnan(block) if block.dtype.kind == "f" else block == fill_value(block.dtype)
        pipeline = PYTHON_PIPELINE if bool(empty.all(axis=1).any()) else fast_pipeline()
        key = f"{name}/c/{number}/0"
        with _pipeline(pipeline), _told(self.files.name, key):
            self._stage(pipeline, block.dtype)[first : first + len(block)] = block
        return key, self.files.move_in(key, self._staging / f"c/{number}/0")

    def write_rows(
        self, name: str, number: int, values: NDArray[Any], length: int, dimensions: Sequence[str]
    ) -> tuple[str, FileSum]:
        """Write chunk `number` of an array other than the signals; returns its key and checksum.

        Args:
          values: of the chunk; its first axis may be shorter than the array's.
          length: of the whole array's first axis.
          dimensions: names of all axes.
        """
        with _pipeline(PYTHON_PIPELINE):
            memory, array = self._rows(values.dtype, (length, *values.shape[1:]), tuple(dimensions))
            first = number * array.chunks[0]
            array[first : first + len(values)] = values
        (chunk,) = (key for key in memory if key != METADATA)
        return f"{name}/{chunk}", self.files.put(f"{name}/{chunk}", memory.pop(chunk).to_bytes())

    def finish(
        self,
        signals: Mapping[str, tuple[np.dtype[Any], Mapping[str, Any]]],
        arrays: Mapping[str, ArrayMeta],
        attributes: Mapping[str, Any],
        written: Mapping[str, FileSum],
    ) -> dict[str, FileSum]:
        """Write all metadata and the list of checksums, the metadata of the store last: then it is
        complete. Returns the keys and checksums of what was written now, but for the list.

        Args:
          signals: type and attributes of each array over mission and time, by name.
          arrays: the other ones.
          attributes: of the store.
          written: all that is there, by key.
        """
        metadata: dict[str, Any] = {}
        with _pipeline(PYTHON_PIPELINE):
            for name, one in arrays.items():
                _, array = self._rows(one.dtype, one.shape, one.dimensions)
                metadata[name] = _document(array, one.attributes)
            like: dict[np.dtype[Any], zarr.Array[Any]] = {}
            for name, (dtype, said) in signals.items():
                if dtype not in like:
                    like[dtype] = self._signal({}, dtype)
                metadata[name] = _document(like[dtype], said)
        group = {
            "zarr_format": 3,
            "node_type": "group",
            "attributes": {**SIMULATED_ATTRIBUTES, **attributes},
            "consolidated_metadata": {
                "kind": "inline",
                "must_understand": False,
                "metadata": metadata,
            },
        }
        sums = {
            f"{name}/{METADATA}": self.files.put(f"{name}/{METADATA}", _compact(document))
            for name, document in metadata.items()
        }
        root = _compact(group)
        sums[METADATA] = FileSum(len(root), hashlib.sha256(root).hexdigest())
        self.files.write(ZARR_LIST, list_text({**written, **sums}, zarr=True))
        self.files.write(METADATA, root)
        return sums

    def write_group(self, name: str, attributes: Mapping[str, Any]) -> dict[str, FileSum]:
        """Write a group that holds nothing but attributes; its key and checksum."""
        document = {"zarr_format": 3, "node_type": "group", "attributes": dict(attributes)}
        return {f"{name}/{METADATA}": self.files.put(f"{name}/{METADATA}", _compact(document))}

    def _stage(self, pipeline: str, dtype: np.dtype[Any]) -> zarr.Array[Any]:
        """An array of the signals' kind in the staging folder."""
        if (pipeline, dtype) not in self._staged:
            with _pipeline(pipeline):
                shutil.rmtree(self._staging, ignore_errors=True)  # of another type
                self._staged[pipeline, dtype] = self._signal(str(self._staging), dtype)
        return self._staged[pipeline, dtype]

    def _signal(self, store: Any, dtype: np.dtype[Any]) -> zarr.Array[Any]:
        """A new array (mission, time) in a folder or in memory; its attributes come later."""
        import zarr
        from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec

        blosc = BloscCodec(
            typesize=dtype.itemsize, cname=COMPRESSOR, clevel=LEVEL, shuffle="shuffle", blocksize=0
        )
        return zarr.create_array(
            store,
            shape=(self.missions, self.samples),
            shards=(self.shard_missions, self.samples),
            chunks=(1, self.samples),
            dtype=dtype,
            fill_value=fill_value(dtype),
            serializer=BytesCodec(),
            compressors=[blosc, Crc32cCodec()],
            dimension_names=(MISSION, TIME),
            config={"write_empty_chunks": True},
        )

    def _rows(
        self, dtype: np.dtype[Any], shape: tuple[int, ...], dimensions: tuple[str, ...]
    ) -> tuple[dict[str, Any], zarr.Array[Any]]:
        """An array in memory whose chunks are not compressed, and that memory. Many arrays of a
        store are alike but for their values, and making one takes zarr some milliseconds."""
        kind = (dtype, shape, dimensions)
        if kind not in self._alike:
            memory: dict[str, Any] = {}
            self._alike[kind] = memory, self._make_rows(memory, dtype, shape, dimensions)
        return self._alike[kind]

    def _make_rows(
        self,
        memory: dict[str, Any],
        dtype: np.dtype[Any],
        shape: tuple[int, ...],
        dimensions: tuple[str, ...],
    ) -> zarr.Array[Any]:
        import zarr
        from zarr.codecs import BytesCodec, Crc32cCodec

        rows = self.row_missions if dimensions[0] == MISSION else shape[0]
        return zarr.create_array(
            memory,
            shape=shape,
            chunks=(min(rows, shape[0]), *shape[1:]),
            dtype=dtype,
            fill_value="" if dtype.kind == TEXT else fill_value(dtype),
            serializer="auto" if dtype.kind == TEXT else BytesCodec(),
            compressors=[Crc32cCodec()],
            dimension_names=dimensions,
            config={"write_empty_chunks": True},
        )


def read_rows(store: Path, name: str, row: int | None = None) -> NDArray[Any]:
    """An array of a store of this machine, or one mission of it; raises whatever zarr does where it
    is damaged, and StoreError where a file of it cannot be read to its end."""
    import zarr

    check_readable(store / name)
    array = zarr.open_array(store / name, mode="r")
    return np.asarray(array[...] if row is None else array[row])


def fill_value(dtype: np.dtype[Any]) -> Any:
    """What stands where an array has nothing: NaN, or the least number of 8 bytes, or 0."""
    if dtype.kind == "f":
        return np.nan
    return np.iinfo(dtype).min if dtype == np.dtype("<i8") else 0


def _document(array: zarr.Array[Any], attributes: Mapping[str, Any]) -> dict[str, Any]:
    """The metadata of an array like this one with these attributes, as its file says them."""
    found: dict[str, Any] = {**array.metadata.to_dict(), "attributes": dict(attributes)}
    return {member: found.get(member, []) for member in _MEMBERS}


def fast_pipeline() -> str:
    """The codec pipeline that is used: `zarrs` where it is installed, else zarr-python's own."""
    return PYTHON_PIPELINE if importlib.util.find_spec("zarrs") is None else RUST_PIPELINE


@contextlib.contextmanager
def fast_reading(store: StorePath) -> Iterator[None]:
    """Have arrays that are opened here decoded by the fast pipeline, which takes a third of the
    time; it reads folders of this machine only."""
    import zarr

    path = fast_pipeline() if isinstance(store, Path) else PYTHON_PIPELINE
    with zarr.config.set({"codec_pipeline.path": path}), warnings.catch_warnings():
        # it warns of arrays of words in stores of others, which the slow pipeline then reads
        for text in ("Array is unsupported by Zarrs", ".*does not have a Zarr V3 specification"):
            warnings.filterwarnings("ignore", text)
        yield


@contextlib.contextmanager
def _pipeline(path: str) -> Iterator[None]:
    """Have zarr use a codec pipeline, with one thread: with more the order of the chunks in a
    shard is one of chance."""
    import zarr

    with zarr.config.set({"codec_pipeline.path": path, "threading.max_workers": 1}):
        yield


@contextlib.contextmanager
def _told(place: str, key: str) -> Iterator[None]:
    """Make an OSError of what the pipeline in Rust raises when the disk refuses."""
    try:
        yield
    except RuntimeError as error:
        raise OSError(errno.EIO, " ".join(str(error).split()), f"{place}/{key}") from error


def _compact(value: Mapping[str, Any]) -> bytes:
    """JSON without white space: a small store is mostly metadata."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()


def flag_attributes(long_name: str, meanings: Sequence[str], first: int = 0) -> dict[str, Any]:
    """CF attributes of an integer that stands for one of `meanings`."""
    return {
        "long_name": long_name,
        "flag_values": list(range(first, first + len(meanings))),
        "flag_meanings": " ".join(meanings),
    }
