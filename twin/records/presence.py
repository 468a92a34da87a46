"""Presence: find out whether a path or address holds a store, an unfinished one or something else.

This module also checks the names of new stores and the schema version of existing ones. It
recognises files of `twin flight`, so that an error can name them.

Only metadata and file names are read, no arrays.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.bounded import check_regular, parse_json
from twin.errors import InputError, StoreError, WriteError, quoted
from twin.records.attributes import PROGRAM_VERSION, SETTINGS, TITLE, VERSION, is_missions
from twin.records.schema import SCHEMA_VERSION
from twin.records.storage.checksums import check_readable, is_listed
from twin.records.storage.sharded import METADATA
from twin.records.storage.store_path import StorePath, files_at, named, store_path

if TYPE_CHECKING:
    import xarray as xr


GENERATING = ".generating"
"""Ending of the folder beside a store that `factory generate` works in until it is complete."""
RECIPE = "recipe.json"
"""File in that folder with the recipe of the store"""
LONGEST_VERSION = 40
"""Maximum number of characters of a program's version that an error message quotes"""
OTHER_FORMATS = (".nc", ".csv", ".txt", ".mat", ".h5", ".json", ".npz", ".parquet", ".mcap")
"""Endings of other formats, which a store's name must not have"""
MAKERS = "`factory generate`, `factory import` and `twin simulate --out` write those"
"""Commands that write stores, as error messages name them"""


def is_store(path: str | StorePath) -> bool:
    """Return whether `path` is a folder with a zarr v3 group of missions, complete or damaged."""
    try:
        return is_missions(read_attributes(path))
    except StoreError:
        return False


def is_derived(path: str | StorePath) -> bool:
    """Return whether `path` is a zarr group that this program wrote and that holds no missions.

    Tracks are an example. A command that replaces such a group must not replace a store."""
    return is_complete(path) and is_listed(path) and not is_store(path)


def is_complete(path: str | StorePath) -> bool:
    """Return whether `path` holds a zarr v3 group; its metadata file is written last."""
    return files_at(path).exists(METADATA)


def generating(path: str | StorePath) -> StorePath:
    """Return the folder beside a store that `factory generate` works in."""
    place = store_path(path)
    place = named(place) if isinstance(place, Path) else place
    return place.parent / f"{place.name}{GENERATING}"


def begun(path: str | StorePath) -> list[StorePath]:
    """Return the work folders of unfinished runs for a store, one folder for each recipe."""
    place = generating(path)
    files = files_at(place)
    return [place / name for name in files.folders() if files.exists(f"{name}/{RECIPE}")]


def is_unfinished(path: str | StorePath) -> bool:
    """Return whether `factory generate` began the store at `path` and did not complete it."""
    return not is_complete(path) and bool(begun(path))


def read_attributes(path: str | StorePath) -> dict[str, Any]:
    """Read the attributes of a store without opening its arrays.

    Raises:
      StoreError: its metadata cannot be read.
    """
    try:
        metadata = parse_json(files_at(path).read_small(METADATA), METADATA)
        attributes: dict[str, Any] = metadata["attributes"]
    except (OSError, InputError, KeyError, TypeError) as error:
        raise StoreError(
            f"store {path} is damaged: its {METADATA} cannot be read ({error}); make it again"
        ) from error
    return attributes


def is_there(path: StorePath) -> bool:
    """Return whether a path or address holds anything; raises OSError."""
    return path.exists() if isinstance(path, Path) else any(files_at(path).all_keys())


def check_ending(path: str | StorePath) -> None:
    """Refuse a store's path with the ending of another format, or without a name.

    Raises:
      WriteError: the ending is one of OTHER_FORMATS, or the path has no name, such as `.`.
    """
    if store_path(path).name in ("", ".."):
        raise WriteError(
            f"{path} is a folder without its name: give the store one, such as missions.zarr"
        )
    stem, dot, ending = str(path).rpartition(".")
    if f"{dot}{ending}".lower() in OTHER_FORMATS:
        raise WriteError(
            f"{path}: a store is a zarr folder, not a .{ending} file: name it {stem}.zarr; "
            "`factory export` makes other formats of it"
        )


def check_version(attributes: Mapping[str, Any], path: str | StorePath) -> None:
    """Raise StoreError if a newer or an unknown program wrote a store.

    Args:
      attributes: attributes of the store.
    """
    try:
        version = int(attributes[VERSION])
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise StoreError(
            f"store {path} does not say its {VERSION}: it is damaged, or a zarr group of another "
            f"program, not a store of missions; {MAKERS}"
        ) from error
    if version > SCHEMA_VERSION:
        try:
            writer = json.loads(attributes[SETTINGS])["versions"]["glider-twin"]
        except (KeyError, ValueError, TypeError, RecursionError):
            writer = attributes.get(PROGRAM_VERSION, "")
        to = f" to {str(writer)[:LONGEST_VERSION]}" if writer else ""
        raise StoreError(
            f"store {path} has schema version {version}, this program reads up to "
            f"{SCHEMA_VERSION}; upgrade glider-twin{to}"
        )


FLIGHT_TITLE = "Flight of underwater gliders by their flight model"
"""First words of the attribute `title` in files that `twin flight` wrote"""
SIGNATURES = (b"\x89HDF", b"CDF")
"""First bytes of netCDF files"""


def is_flight(path: str | StorePath) -> bool:
    """Return whether `path` is a file or a zarr folder that `twin flight` wrote."""
    path = store_path(path)
    try:
        if not isinstance(path, Path) or path.is_dir():
            about = json.loads(files_at(path).read_small(METADATA)).get("attributes", {})
            return str(about.get(TITLE, "")).startswith(FLIGHT_TITLE)
        check_regular(path)
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
    """Open a file of `twin flight` lazily; raises StoreError, or the error of xarray's reader."""
    import xarray as xr

    check_readable(path)
    return xr.open_zarr(path) if path.is_dir() else xr.open_dataset(path)


def flight_message(path: str | StorePath) -> str:
    """Return the error message for a file of `twin flight` in place of a store."""
    return (
        f"{path} is a flight, which `twin flight` wrote: `twin plot {quoted(path)}` draws it; "
        "this needs the store that it was made from"
    )
