"""Sharded: a store of simulated missions written shard by shard, through zarr.

One mission is one chunk. Chunks are packed into shards of SHARD_MISSIONS missions, so that a store
of thousands of missions has hundreds of files, and each carries a CRC-32C, so that damage is found
wherever it is read. zarr-python writes all of it: with the codec pipeline `zarrs` where that is
installed, else with its own, which gives the same bytes and takes three times as long.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import importlib.util
import json
import math
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.place import (
    ATTRIBUTES,
    COORDINATE_DTYPES,
    COORDINATES,
    DATETIME,
    FLOWN,
    NO_TIME,
    PLACE,
)
from twin.records.schema import MISSION, TIME, VARIABLES

if TYPE_CHECKING:
    import zarr

SHARD_MISSIONS = 64
"""Missions in a shard, or all of a smaller store: 48 h of preset paper, a MB per variable."""
COMPRESSOR: Literal["zstd"] = "zstd"
LEVEL = 1
"""Higher levels cost twice the time and gain a tenth of the size."""
DTYPE = np.dtype("<f4")
"""Of signals"""
BESIDE = "coordinates"
"""CF attribute that names what xarray makes coordinates"""
METADATA = "zarr.json"
PYTHON_PIPELINE = "zarr.core.codec_pipeline.BatchedCodecPipeline"
RUST_PIPELINE = "zarrs.ZarrsCodecPipeline"
_MEMBERS = (
    *("zarr_format", "node_type", "shape", "data_type", "chunk_grid", "chunk_key_encoding"),
    *("fill_value", "codecs", "dimension_names", "attributes", "storage_transformers"),
)
"""Order of an array's metadata in its file: runs know their store by the bytes of its files."""


@dataclass(frozen=True)
class SmallArray:
    """An array that is not a signal: a coordinate, or one value or a few of each mission."""

    values: NDArray[Any]
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


def shard_missions(missions: int) -> int:
    """Missions in each shard of a store of `missions`."""
    return min(missions, SHARD_MISSIONS)


class ShardedStore:
    """A store that grows by shards; it is complete when `finish` has written its `zarr.json`.

    Every file appears under its name only when it is whole: shards are written in `staging`, a
    folder of the same file system, and moved.
    """

    def __init__(self, path: Path, *, missions: int, samples: int, staging: Path):
        """`samples` are those of the longest mission."""
        self.path, self.missions, self.samples = path, missions, samples
        self._staging = staging

    @functools.cached_property
    def _staged(self) -> dict[tuple[str, np.dtype[Any]], zarr.Array[Any]]:
        """An array of each kind in the staging folder, by codec pipeline and type."""
        staged = {}
        kinds: set[np.dtype[Any]] = {DTYPE, *COORDINATE_DTYPES.values()}
        for pipeline in {fast_pipeline(), PYTHON_PIPELINE}:
            with _pipeline(pipeline):
                for kind in kinds:
                    shutil.rmtree(self._staging, ignore_errors=True)  # of an earlier run
                    staged[pipeline, kind] = self._samples(str(self._staging), kind)
        return staged

    def prepare(self) -> None:
        """Get zarr ready, which takes a tenth of a second; `write_shard` else does it itself."""
        self._staged  # noqa: B018

    def write_shard(self, number: int, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write shard `number` of every signal and coordinate.

        Args:
          arrays: signals by schema name and coordinates of `twin.records.place`, each
            (missions of the shard, samples), padded with NaN or NO_TIME.

        Raises:
          OSError: the disk refuses.
        """
        first = number * shard_missions(self.missions)
        for name, block in arrays.items():
            # zarrs leaves out a chunk of nothing but the fill value, zarr-python keeps it as asked
            filled = np.isnan(block) if block.dtype.kind == "f" else block == NO_TIME
            pipeline = PYTHON_PIPELINE if filled.all(axis=1).any() else fast_pipeline()
            with _pipeline(pipeline), _told(self.path / name):
                self._staged[pipeline, block.dtype][first : first + len(block)] = block
            target = self.path / name / "c" / str(number) / "0"
            target.parent.mkdir(parents=True, exist_ok=True)
            (self._staging / "c" / str(number) / "0").replace(target)

    def finish(self, arrays: Mapping[str, SmallArray], attributes: Mapping[str, Any]) -> None:
        """Write everything but the signals; `zarr.json` of the store comes last."""
        metadata: dict[str, Any] = {}
        with _pipeline(PYTHON_PIPELINE):
            like_small = functools.cache(_small)
            for name, small in arrays.items():
                memory, array = like_small(small.values.shape, small.values.dtype, small.dimensions)
                array[...] = small.values
                for key, buffer in memory.items():
                    if key != METADATA:
                        (self.path / name / key).parent.mkdir(parents=True, exist_ok=True)
                        write_whole(self.path / name / key, buffer.to_bytes())
                metadata[name] = _document(array, small.attributes)
            there = [name for name in COORDINATES if self._has(name)]
            for name in there:
                own = FLOWN if name != DATETIME else {}
                array = self._samples({}, COORDINATE_DTYPES[name])
                metadata[name] = _document(array, {**ATTRIBUTES[name], **own})
            signal = self._samples({}, DTYPE)
        beside = {BESIDE: " ".join(there)} if there else {}
        for name, variable in VARIABLES.items():
            if self._has(name):
                metadata[name] = _document(signal, {**variable.stored_attributes(), **beside})
        starts = [name for name in PLACE if name in arrays]
        beside = {BESIDE: " ".join(starts)} if starts else {}  # of no signal: of the store
        for name, document in metadata.items():
            write_whole(self.path / name / METADATA, _compact(document))
        group = {
            "zarr_format": 3,
            "node_type": "group",
            "attributes": {**SIMULATED_ATTRIBUTES, **attributes, **beside},
            "consolidated_metadata": {
                "kind": "inline",
                "must_understand": False,
                "metadata": metadata,
            },
        }
        write_whole(self.path / METADATA, _compact(group))

    def _has(self, name: str) -> bool:
        """Whether a shard of that array was written."""
        return (self.path / name / "c").is_dir()

    def _samples(self, store: Any, kind: np.dtype[Any]) -> zarr.Array[Any]:
        """A new array (mission, time) in a folder or in memory; its attributes come later."""
        import zarr
        from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec

        blosc = BloscCodec(
            typesize=kind.itemsize, cname=COMPRESSOR, clevel=LEVEL, shuffle="shuffle", blocksize=0
        )
        return zarr.create_array(
            store,
            shape=(self.missions, self.samples),
            shards=(shard_missions(self.missions), self.samples),
            chunks=(1, self.samples),
            dtype=kind,
            fill_value=np.nan if kind.kind == "f" else int(NO_TIME),
            serializer=BytesCodec(),
            compressors=[blosc, Crc32cCodec()],
            dimension_names=(MISSION, TIME),
            config={"write_empty_chunks": True},
        )


def _small(
    shape: tuple[int, ...], dtype: np.dtype[Any], dimensions: tuple[str, ...]
) -> tuple[dict[str, Any], zarr.Array[Any]]:
    """A new array in one chunk that is not compressed, and the memory that it is in."""
    import zarr
    from zarr.codecs import BytesCodec, Crc32cCodec

    memory: dict[str, Any] = {}
    array = zarr.create_array(
        memory,
        shape=shape,
        chunks=shape,
        dtype=dtype,
        fill_value=np.nan if dtype.kind == "f" else 0,
        serializer=BytesCodec(),
        compressors=[Crc32cCodec()],
        dimension_names=dimensions,
        config={"write_empty_chunks": True},
    )
    return memory, array


def _document(array: zarr.Array[Any], attributes: Mapping[str, Any]) -> dict[str, Any]:
    """The metadata of an array like this one with these attributes, as its file says them."""
    found: dict[str, Any] = {**array.metadata.to_dict(), "attributes": dict(attributes)}
    return {member: found.get(member, []) for member in _MEMBERS}


def fast_pipeline() -> str:
    """The codec pipeline that is used: `zarrs` where it is installed, else zarr-python's own."""
    return PYTHON_PIPELINE if importlib.util.find_spec("zarrs") is None else RUST_PIPELINE


@contextlib.contextmanager
def _pipeline(path: str) -> Iterator[None]:
    """Have zarr use a codec pipeline, with one thread: with more the order of the chunks in a
    shard is one of chance."""
    import zarr

    with zarr.config.set({"codec_pipeline.path": path, "threading.max_workers": 1}):
        yield


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """Make an OSError of what the pipeline in Rust raises when the disk refuses."""
    try:
        yield
    except RuntimeError as error:
        raise OSError(errno.EIO, " ".join(str(error).split()), str(path)) from error


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


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is there completely or not at all."""
    # the name of the process: two of them may write the same file, with the same bytes
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
