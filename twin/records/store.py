"""Store: missions in zarr, read and written with the schema; `xarray.open_zarr` just works.

Layout: arrays (mission, time) in float32 with NaN padding, `n_samples(mission)`, `time` in
seconds since each mission's start, `datetime`, `latitude` and `longitude` of each sample,
`state(mission, time, state)` in float64 with MuJoCo's exact state, and attributes that say what the
data are. The factory writes the same layout in bulk.
"""

from __future__ import annotations

import contextlib
import errno
import json
import warnings
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.bounded import check_dataset
from twin.errors import StoreError, WriteError, quoted
from twin.records.attributes import PROGRAM_VERSION, SETTINGS, VERSION
from twin.records.coordinates import read_place
from twin.records.mission_dataset import STATES, signal_names, stored_columns
from twin.records.presence import (
    flight_message,
    is_complete,
    is_flight,
    is_store,
    is_there,
    is_unfinished,
    read_attributes,
)
from twin.records.schema import MISSION, SCHEMA_VERSION, TIME, declare_stored
from twin.records.storage.checksums import check_readable
from twin.records.storage.object_storage import files_at
from twin.records.storage.store_arrays import (
    check_arrays,
    check_mission,
    mission_samples,
    read_array,
)
from twin.records.storage.store_path import StorePath, store_path
from twin.records.storage.whole import check_folder_target, recover, whole_folder
from twin.records.trajectory import Trajectory

if TYPE_CHECKING:
    import xarray as xr

LONGEST_VERSION = 40
"""Characters of the version of a program, as messages quote it"""


def write_store(dataset: xr.Dataset, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a dataset as a zarr store, whole or not at all, with a list of its files' checksums.

    Args:
      overwrite: take the place of a store, which stays until the new one is complete.

    Raises:
      WriteError: something else than a store is in the way, it exists and `overwrite` is False,
        or the disk refuses.
    """
    path = Path(path)
    with whole_folder(path, overwrite=overwrite, ours=is_store) as folder:
        write_zarr(dataset, folder)
    return path


def write_zarr(
    dataset: xr.Dataset, folder: Path, *, along: str | None = None, beside: bool = False
) -> None:
    """Write any dataset as a zarr v3 group that `xarray.open_zarr(path)` opens without options.

    Each chunk has a CRC-32C, so that whatever reads a changed one fails. `folder` is one of
    `whole_folder`: a kill leaves part of the group.

    Args:
      along: dimension along which the arrays of the group that is there grow.
      beside: the arrays are added to those of the group that is there.
    """
    from zarr.codecs import Crc32cCodec, ZstdCodec

    codecs = {"compressors": [ZstdCodec(), Crc32cCodec()]}
    encoding = {} if along else dict.fromkeys(dataset.variables, codecs)
    how: dict[str, Any] = {"mode": "a" if along or beside else "w"}
    if along:
        how["append_dim"] = along
    with warnings.catch_warnings():
        # zarr 3 warns that its specification does not name consolidated metadata yet
        warnings.filterwarnings("ignore", "Consolidated metadata")
        dataset.to_zarr(folder, zarr_format=3, consolidated=True, encoding=encoding, **how)


def read_zarr(folder: Path) -> xr.Dataset:
    """A group that `write_zarr` wrote, its arrays read when they are asked for."""
    import xarray as xr

    return xr.open_zarr(folder, consolidated=None, chunks=None)


def write_netcdf(
    dataset: xr.Dataset, path: Path, encoding: Mapping[str, Any] | None = None
) -> None:
    """Write any dataset as netCDF4; `path` is one of `whole_file`: a kill leaves half a file.

    Raises:
      OSError: the disk refuses, of which the netCDF library gives no reason.
    """
    try:
        dataset.to_netcdf(path, engine="netcdf4", encoding=encoding)
    except RuntimeError as error:
        raise OSError(errno.EIO, " ".join(str(error).split()), str(path)) from error


OTHER_FORMATS = (".nc", ".csv", ".txt", ".mat", ".h5", ".json", ".npz", ".parquet", ".mcap")
"""Endings that would promise a file of another format"""


def check_ending(path: str | StorePath) -> None:
    """Refuse a store's name that ends as a file of another format does, and a place without one.

    Raises:
      WriteError: it does, or the path is that of a folder without its name, such as `.`.
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


def check_target(path: str | Path, *, overwrite: bool) -> None:
    """Refuse what `write_store` would refuse, before long work.

    Raises:
      WriteError: the name ends as that of another format, something else than a store is in the
        way, or it exists and `overwrite` is False.
    """
    check_ending(path)
    check_folder_target(path, overwrite=overwrite, ours=is_store)


def open_store(path: str | StorePath, *, dask: bool = True) -> xr.Dataset:
    """Open a store lazily.

    Args:
      dask: whether its arrays are dask's, in chunks of the store's own, where that is installed;
        else an array is read when it is asked for.

    Raises:
      StoreError: missing, not a store of this schema, written by a newer version, or one of its
        files is no regular file or too large to be what it must be.
    """
    import xarray as xr

    path = store_path(path)
    if isinstance(path, Path) and not path.exists():
        with contextlib.suppress(OSError):  # a kill between two renames may have left it beside
            recover(path)
    if _unfinished(path):
        raise StoreError(
            f"store {path} is incomplete: the `factory generate` command that began it, with "
            "--resume, completes it"
        )
    if is_flight(path):
        raise StoreError(flight_message(path))
    if not is_there(path):
        raise StoreError(
            f"no store at {path}; make one with `factory generate --out {quoted(path)}`, or of "
            f"logs with `factory import KIND FILES --out {quoted(path)}`"
        )
    if not is_complete(path):
        raise StoreError(_no_store(path))
    check_readable(path)
    files = files_at(path)
    attributes = read_attributes(path)
    check_version(attributes, path)
    chunks: dict[str, int] | None = {} if dask and find_spec("dask") is not None else None
    try:
        dataset = xr.open_zarr(files.zarr_store(), consolidated=None, chunks=chunks)
    except Exception as error:
        raise StoreError(f"store {path} cannot be read: {' '.join(str(error).split())}") from error
    check_dataset(dataset, files.stored_bytes, f"store {path}", StoreError)
    declare_signals(dataset)
    return dataset


MAKERS = "`factory generate`, `factory import` and `twin simulate --out` write those"
"""What makes stores"""


def _no_store(path: str | StorePath) -> str:
    """What something is that is no zarr v3 store."""
    place = store_path(path)
    if isinstance(place, Path) and place.is_file():
        what = "a file; a store of missions is a folder (zarr)"
    elif isinstance(place, Path) and (place / ".zgroup").exists():
        what = "a store of zarr's version 2; stores of missions are of version 3"
    elif isinstance(place, Path) and not any(place.iterdir()):
        what = "an empty folder, not a store of missions"
    else:
        what = "not a zarr v3 store of missions; give the folder itself, such as missions.zarr"
    return f"{path} is {what}; {MAKERS}"


def check_version(attributes: Mapping[str, Any], path: str | StorePath) -> None:
    """Raise StoreError when a newer program wrote a store, or one that is not ours.

    Args:
      attributes: of the store.
    """
    try:
        version = int(attributes[VERSION])
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise StoreError(
            f"store {path} does not say its {VERSION}: it is damaged, or a zarr group of another "
            f"program, not a store of missions; {MAKERS}"
        ) from error
    if version > SCHEMA_VERSION:
        writer = _writer(attributes)
        raise StoreError(
            f"store {path} has schema version {version}, this program reads up to "
            f"{SCHEMA_VERSION}; upgrade glider-twin{f' to {writer}' if writer else ''}"
        )


def _writer(attributes: Mapping[str, Any]) -> str:
    """The version of glider-twin that wrote a store; empty where it does not say."""
    try:
        made = json.loads(attributes[SETTINGS])["versions"]["glider-twin"]
    except (KeyError, ValueError, TypeError, RecursionError):
        made = attributes.get(PROGRAM_VERSION, "")
    return str(made)[:LONGEST_VERSION]


def _unfinished(path: StorePath) -> bool:
    """`is_unfinished`, with a StoreError where the place cannot be read at all."""
    try:
        return is_unfinished(path)
    except OSError as error:
        raise StoreError(
            f"store {path} cannot be read: {error.filename}: {error.strerror}"
        ) from error


def declare_signals(dataset: xr.Dataset) -> None:
    """Declare the signals of a store that this process does not know."""
    signals = {
        str(name): array.attrs
        for name, array in dataset.data_vars.items()
        if array.dims == (MISSION, TIME)
    }
    for name in signals:
        declare_stored(name, signals[name])


def read_trajectory(path: str | StorePath, mission: int = 0) -> Trajectory:
    """One mission of a store.

    Raises:
      StoreError: as `open_store`, there is no such mission (the range is named), or the store is
        damaged: an array is gone, cannot be decoded or has gaps where samples must be.
    """
    dataset = open_store(path, dask=False)
    check_mission(mission, dataset.sizes.get(MISSION, 0), f"store {path}")
    check_arrays(dataset, path)
    one = dataset.isel({MISSION: mission})
    samples = mission_samples(one, path, mission)
    one = one.isel({TIME: slice(0, samples)})
    signals = {name: read_array(one, name, path).astype(float) for name in signal_names(one)}
    states = read_array(one, STATES, path) if STATES in one else np.zeros((0, 0))
    if not np.isfinite(states).all():
        raise StoreError(f"store {path} is damaged: {STATES} of mission {mission} has gaps")
    return Trajectory(
        time=read_array(one, TIME, path).astype(float),
        signals=signals,
        states=states,
        state_columns=stored_columns(one),
        provenance={**dataset.attrs, **read_place(one)},
    )
