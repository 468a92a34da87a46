"""Flight file: recognises what `twin flight` wrote, so that an error can name it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from twin.errors import quoted
from twin.records.attributes import TITLE
from twin.records.object_files import files_at
from twin.records.sharded import METADATA
from twin.records.store_path import StorePath, store_path

if TYPE_CHECKING:
    import xarray as xr

FLIGHT_TITLE = "Flight of underwater gliders by their flight model"
"""With which the title of such a file begins"""
SIGNATURES = (b"\x89HDF", b"CDF")
"""First bytes of netCDF files"""


def is_flight(path: str | StorePath) -> bool:
    """Whether `path` is a file or a zarr folder that `twin flight` wrote."""
    path = store_path(path)
    try:
        if not isinstance(path, Path) or path.is_dir():
            about = json.loads(files_at(path).read_small(METADATA)).get("attributes", {})
            return str(about.get(TITLE, "")).startswith(FLIGHT_TITLE)
        with path.open("rb") as file:
            if not file.read(4).startswith(SIGNATURES):
                return False
    except (OSError, ValueError, AttributeError, RecursionError):
        return False
    import netCDF4

    try:
        with netCDF4.Dataset(path) as dataset:
            return str(getattr(dataset, TITLE, "")).startswith(FLIGHT_TITLE)
    except OSError:
        return False


def open_flight(path: Path) -> xr.Dataset:
    """Such a file or folder, lazily; raises whatever its reader does."""
    import xarray as xr

    return xr.open_zarr(path) if path.is_dir() else xr.open_dataset(path)


def flight_message(path: str | StorePath) -> str:
    """What a reader of stores says of such a file."""
    return (
        f"{path} is a flight, which `twin flight` wrote: `twin plot {quoted(path)}` draws it; "
        "this needs the store that it was made from"
    )
