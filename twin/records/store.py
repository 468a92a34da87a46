"""Store: write and read missions in zarr with the schema, also readable by `xarray.open_zarr`.

Layout: arrays (mission, time) in float32 with NaN padding, `n_samples(mission)`, `time` in
seconds since each mission's start, `datetime`, `latitude` and `longitude` of each sample,
`simulation_state(mission, time, state)` in float64 with MuJoCo's exact state, and attributes that
describe the data. The factory writes this layout in bulk.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import warnings
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.bounded import check_dataset
from twin.errors import InputError, StoreError, quoted
from twin.records.attributes import N_SAMPLES, is_missions
from twin.records.coordinates import read_place
from twin.records.mission_dataset import STATES, signal_names, stored_columns
from twin.records.presence import (
    MAKERS,
    check_ending,
    check_version,
    flight_message,
    is_complete,
    is_flight,
    is_store,
    is_there,
    is_unfinished,
    read_attributes,
)
from twin.records.schema import MISSION, TIME, declare_stored
from twin.records.storage.checksums import check_readable, has_checksums, read_checksums
from twin.records.storage.sharded import METADATA
from twin.records.storage.store_path import (
    StorePath,
    check_addresses,
    files_at,
    store_path,
)
from twin.records.storage.whole import check_folder_target, recover, whole_file, whole_folder
from twin.records.trajectory import Trajectory

if TYPE_CHECKING:
    import xarray as xr

ENDINGS = (".zarr", ".nc")
"""Endings of the files that missions can be saved as"""


def write_store(dataset: xr.Dataset, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a dataset atomically as a zarr store, with a list of its files' checksums.

    Args:
      overwrite: replace an existing store, which stays until the new store is complete.

    Raises:
      WriteError: `path` exists and is no store, or it is a store and `overwrite` is False, or the
        disk refuses.
    """
    path = Path(path)
    with whole_folder(path, overwrite=overwrite, ours=is_store) as folder:
        write_zarr(dataset, folder)
    return path


def write_zarr(
    dataset: xr.Dataset, folder: Path, *, along: str | None = None, beside: bool = False
) -> None:
    """Write any dataset as a zarr v3 group that `xarray.open_zarr(path)` opens without options.

    Each chunk has a CRC-32C, so any reader of a damaged chunk fails. `folder` must come from
    `whole_folder`: without it, a killed process leaves part of the group.

    Args:
      along: dimension along which the dataset is appended to the existing group's arrays.
      beside: whether the arrays are added to those of the existing group.
    """
    from zarr.codecs import Crc32cCodec, ZstdCodec

    codecs = {"compressors": [ZstdCodec(), Crc32cCodec()]}
    encoding = {} if along else dict.fromkeys(dataset.variables, codecs)
    how: dict[str, Any] = {"mode": "a" if along or beside else "w"}
    if along:
        how["append_dim"] = along
    with warnings.catch_warnings():
        # zarr 3 warns that its specification does not contain consolidated metadata yet
        warnings.filterwarnings("ignore", "Consolidated metadata")
        dataset.to_zarr(folder, zarr_format=3, consolidated=True, encoding=encoding, **how)


def read_zarr(folder: Path) -> xr.Dataset:
    """Open a group that `write_zarr` wrote; its arrays are read on access."""
    import xarray as xr

    return xr.open_zarr(folder, consolidated=None, chunks=None)


def write_netcdf(
    dataset: xr.Dataset, path: Path, encoding: Mapping[str, Any] | None = None
) -> None:
    """Write a dataset as netCDF4; `path` is from `whole_file`, or a killed process leaves a part.

    Raises:
      OSError: the disk refuses; the netCDF library gives no reason.
    """
    try:
        dataset.to_netcdf(path, engine="netcdf4", encoding=encoding)
    except RuntimeError as error:
        raise OSError(errno.EIO, " ".join(str(error).split()), str(path)) from error


def save_missions(dataset: xr.Dataset, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write missions as a store if the name ends in .zarr, as netCDF if it ends in .nc.

    Raises:
      InputError: `path` ends neither in .zarr nor in .nc. WriteError: as `write_store`.
    """
    check_addresses(path := Path(path))
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise InputError(f"cannot save {path.name!r}: the name must end in {' or '.join(ENDINGS)}")
    if ending == ".zarr":
        return write_store(dataset, path, overwrite=overwrite)
    with whole_file(path, overwrite=overwrite) as place:
        write_netcdf(dataset, place)
    return path


def check_target(path: str | Path, *, overwrite: bool) -> None:
    """Raise the errors of `write_store` before long work begins.

    Raises:
      WriteError: the name has the ending of another format, `path` exists and is no store, or it
        is a store and `overwrite` is False.
    """
    check_ending(path)
    check_folder_target(path, overwrite=overwrite, ours=is_store)


def open_store(path: str | StorePath, *, dask: bool = True) -> xr.Dataset:
    """Open a store lazily.

    Args:
      dask: use dask arrays with the store's own chunks, if dask is installed; else each array is
        read on access.

    Raises:
      StoreError: missing, not a store of this schema, written by a newer version, or one of its
        files is not regular or too large.
    """
    import xarray as xr

    path = store_path(path)
    if isinstance(path, Path) and not path.exists():
        with contextlib.suppress(OSError):  # a killed process may have left it in the hidden folder
            recover(path)
    try:
        unfinished = is_unfinished(path)
    except OSError as error:
        raise StoreError(
            f"store {path} cannot be read: {error.filename}: {error.strerror}"
        ) from error
    if unfinished:
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
        raise StoreError(f"{path} is {_describe_other(path)}; {MAKERS}")
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


def _describe_other(path: StorePath) -> str:
    """Describe a path that is no zarr v3 store, for an error message."""
    if isinstance(path, Path):
        if path.is_file():
            return "a file; a store of missions is a folder (zarr)"
        if (path / ".zgroup").exists():
            return "a store of zarr's version 2; stores of missions are of version 3"
        if not any(path.iterdir()):
            return "an empty folder, not a store of missions"
    return "not a zarr v3 store of missions; give the folder itself, such as missions.zarr"


def declare_signals(dataset: xr.Dataset) -> None:
    """Declare the signals of a store that the schema lacks, such as those of a user's parts."""
    for name, array in dataset.data_vars.items():
        if array.dims == (MISSION, TIME):
            declare_stored(str(name), array.attrs)


def check_mission(mission: int, count: int, what: str) -> None:
    """Raise StoreError if `mission` is not one of `count` missions.

    Args:
      what: name of the store or file for the error message.
    """
    check_filled(count, what)
    if not 0 <= mission < count:
        raise StoreError(f"{what} has missions 0 to {count - 1}, not {mission}")


def check_filled(count: int, what: str) -> None:
    """Raise StoreError if `count`, the number of missions in a store or file, is zero."""
    if count == 0:
        raise StoreError(f"{what} holds no missions; make some with `factory generate`")


def gone_arrays(dataset: xr.Dataset, path: str | StorePath) -> list[str]:
    """List the arrays whose own metadata file is missing; xarray would read them as NaN.

    Args:
      dataset: result of `open_store`.
    """
    files = files_at(path)
    return [name for name in map(str, dataset.variables) if not files.exists(f"{name}/{METADATA}")]


def check_arrays(dataset: xr.Dataset, path: str | StorePath) -> None:
    """Raise StoreError that names the first missing array, or the first missing file of a chunk."""
    for name in gone_arrays(dataset, path)[:1]:
        raise _missing_array(name, path)
    for name in map(str, dataset.variables):
        check_chunks(dataset, name, path)


def check_chunks(dataset: xr.Dataset, name: str, path: str | StorePath) -> None:
    """Raise StoreError if a file of an array is missing; zarr would read missing values.

    A missing file is damage only if the store's list of checksums names it, because a chunk without
    values has no file. The list is read only if a file is missing. Stores without a list are not
    checked, nor are those in an object storage, where each check would be a request.

    Args:
      dataset: result of `open_store`, with all missions.
    """
    place, variable = store_path(path), dataset.variables[name]
    chunks = variable.encoding.get("shards") or variable.encoding.get("chunks")
    if not isinstance(place, Path) or chunks is None:
        return
    files = files_at(place)
    if not files.exists(f"{name}/{METADATA}"):
        raise _missing_array(name, path)
    grid = (range(-(-n // size)) for n, size in zip(variable.shape, chunks, strict=True))
    keys = ("/".join((name, "c", *map(str, cell))) for cell in itertools.product(*grid))
    absent = [key for key in keys if not files.exists(key)]
    if not absent or not has_checksums(place):
        return
    listed = read_checksums(place)
    gone = [key for key in absent if key in listed]
    if gone:
        more = f" and {len(gone) - 1} more of" if len(gone) > 1 else " of"
        raise StoreError(
            f"store {path} is damaged: file {gone[0]}{more} its array {name} is gone, and would "
            f"read as missing values; `factory verify {quoted(path)}` names all damage: bring the "
            "files back from a copy or make the store again"
        )


def _missing_array(name: str, path: str | StorePath) -> StoreError:
    return StoreError(f"store {path} is damaged: its array {name} is gone; make it again")


def read_array(dataset: xr.Dataset, name: str, path: str | StorePath) -> np.ndarray:
    """Read an array of a dataset from `open_store`, or of a selection of its missions.

    Raises:
      StoreError: the array's files are missing or cannot be decoded.
    """
    if not files_at(path).exists(f"{name}/{METADATA}"):
        raise _missing_array(name, path)
    try:
        return np.asarray(dataset[name].values)
    except Exception as error:  # any error of a decoder means damaged files
        why = " ".join(str(error).split()) or type(error).__name__
        raise StoreError(
            f"store {path} is damaged: its array {name} cannot be read ({why}); make it again, or "
            "bring back its files from a copy"
        ) from error


def read_trajectory(path: str | StorePath, mission: int = 0) -> Trajectory:
    """Read one mission of a store.

    Raises:
      StoreError: as `open_store`, there is no such mission (the error names the range), or an
        array is missing, cannot be decoded or has gaps.
    """
    dataset = open_store(path, dask=False)
    check_mission(mission, dataset.sizes.get(MISSION, 0), f"store {path}")
    check_arrays(dataset, path)
    one = dataset.isel({MISSION: mission})
    if N_SAMPLES not in one:
        raise StoreError(f"store {path} is damaged: it has no array {N_SAMPLES}")
    samples = int(np.nan_to_num(read_array(one, N_SAMPLES, path), nan=0.0))
    if not 0 < samples <= one.sizes[TIME]:
        raise StoreError(
            f"store {path} is damaged: mission {mission} has {samples} of at most "
            f"{one.sizes[TIME]} samples"
        )
    one = one.isel({TIME: slice(0, samples)})
    trajectory = _trajectory(one, lambda name: read_array(one, name, path))
    if not np.isfinite(trajectory.states).all():
        raise StoreError(f"store {path} is damaged: {STATES} of mission {mission} has gaps")
    return trajectory


def _trajectory(one: xr.Dataset, read: Callable[[str], np.ndarray]) -> Trajectory:
    """Make a trajectory of a mission's dataset without padding; `read` reads an array by name."""
    return Trajectory(
        time=read(TIME).astype(float),
        signals={name: read(name).astype(float) for name in signal_names(one)},
        states=read(STATES) if STATES in one else np.zeros((0, 0)),
        state_columns=stored_columns(one),
        provenance={**one.attrs, **read_place(one)},
    )


def open_trajectory(path: str | Path, mission: int = 0) -> Trajectory:
    """Read one mission of a store, or of a netCDF file that `Trajectory.save` wrote.

    Raises:
      StoreError: as `read_trajectory`; or `Trajectory.save` did not write the netCDF file.
    """
    place = store_path(path)
    if place.suffix.lower() != ".nc":
        return read_trajectory(place, mission)
    import xarray as xr

    path = Path(path)
    if not isinstance(place, Path) or not path.is_file():
        raise StoreError(f"no file at {path}; `trajectory.save({str(path)!r})` writes one")
    try:
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as dataset:
            check_dataset(dataset, path, f"file {path}", StoreError)
            if not is_missions(dataset.attrs) or N_SAMPLES not in dataset:
                raise StoreError(f"{path} holds no mission: `Trajectory.save` writes such files")
            check_mission(mission, dataset.sizes[MISSION], str(path))
            declare_signals(dataset)
            one = dataset.isel({MISSION: mission}).load()
            one = one.isel({TIME: slice(0, int(one[N_SAMPLES]))})
            return _trajectory(one, lambda name: np.asarray(one[name].values))
    except (OSError, ValueError) as error:
        if isinstance(error, StoreError):
            raise
        raise StoreError(f"file {path} cannot be read: {' '.join(str(error).split())}") from error
