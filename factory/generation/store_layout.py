"""Layout: the zarr v3 metadata of a store, written without the zarr library.

One mission is one chunk; chunks are packed into shards of SHARD_MISSIONS missions (zarr's
`sharding_indexed` codec), so that a store of thousands of missions has hundreds of files. Every
chunk carries a CRC-32C, so damage is found wherever it is read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.recipe.plan import SPLITS
from twin.records.schema import MISSION, TIME, Variable
from twin.records.store import GLOBAL_ATTRIBUTES

SHARD_MISSIONS = 64
"""Missions in a shard, or all of a smaller store: 48 h of preset paper, a MB per variable."""
COMPRESSOR, LEVEL = "zstd", 1
"""Higher levels cost twice the time and gain a tenth of the size."""
SEGMENT = "segment"
DTYPE = np.dtype("<f4")

_BYTES = {"name": "bytes", "configuration": {"endian": "little"}}
_CRC = {"name": "crc32c"}


def shard_missions(missions: int) -> int:
    """Missions in each shard of a store of `missions`."""
    return min(missions, SHARD_MISSIONS)


def signal_metadata(variable: Variable, missions: int, samples: int) -> dict[str, Any]:
    """`zarr.json` of a signal (mission, time)."""
    attributes: dict[str, Any] = variable.attributes()
    if variable.decimals is not None:
        attributes["least_significant_digit"] = variable.decimals
    blosc = {
        "name": "blosc",
        "configuration": {
            "typesize": DTYPE.itemsize,
            "cname": COMPRESSOR,
            "clevel": LEVEL,
            "shuffle": "shuffle",
            "blocksize": 0,
        },
    }
    sharding = {
        "name": "sharding_indexed",
        "configuration": {
            "chunk_shape": [1, samples],
            "codecs": [_BYTES, blosc, _CRC],
            "index_codecs": [_BYTES, _CRC],
            "index_location": "end",
        },
    }
    return _array_metadata(
        (missions, samples),
        chunk=(shard_missions(missions), samples),
        data_type="float32",
        fill="NaN",
        codecs=[sharding],
        dimensions=(MISSION, TIME),
        attributes=attributes,
    )


def small_metadata(
    values: NDArray[Any], dimensions: Sequence[str], attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """`zarr.json` of an array in one uncompressed chunk."""
    codec = _BYTES if values.dtype.itemsize > 1 else {"name": "bytes"}
    return _array_metadata(
        values.shape,
        chunk=values.shape,
        data_type=values.dtype.name,
        fill="NaN" if values.dtype.kind == "f" else 0,
        codecs=[codec, _CRC],
        dimensions=dimensions,
        attributes=attributes,
    )


def _array_metadata(
    shape: Sequence[int],
    *,
    chunk: Sequence[int],
    data_type: str,
    fill: str | int,
    codecs: list[Any],
    dimensions: Sequence[str],
    attributes: Mapping[str, Any],
) -> dict[str, Any]:
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": list(shape),
        "data_type": data_type,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(chunk)}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": fill,
        "codecs": codecs,
        "dimension_names": list(dimensions),
        "attributes": dict(attributes),
        "storage_transformers": [],
    }


def group_metadata(
    attributes: Mapping[str, Any], arrays: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """`zarr.json` of the store, with the metadata of its arrays beside its own."""
    return {
        "zarr_format": 3,
        "node_type": "group",
        "attributes": {**GLOBAL_ATTRIBUTES, **attributes},
        "consolidated_metadata": {
            "kind": "inline",
            "must_understand": False,
            "metadata": dict(arrays),
        },
    }


def split_attributes() -> dict[str, Any]:
    """Attributes of `split`."""
    return flag_attributes("what the mission is for; missions are split, never samples", SPLITS, 0)


def flag_attributes(long_name: str, meanings: Sequence[str], first: int) -> dict[str, Any]:
    """CF attributes of an integer that stands for one of `meanings`."""
    return {
        "long_name": long_name,
        "flag_values": list(range(first, first + len(meanings))),
        "flag_meanings": " ".join(meanings),
    }
