"""Trajectory file: one trajectory as an xarray dataset, as a zarr store and as netCDF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.bounded import check_dataset
from twin.errors import InputError, StoreError
from twin.records.attributes import N_SAMPLES, SCHEMA, SIMULATED_ATTRIBUTES
from twin.records.coordinates import (
    DATETIME,
    FLOWN,
    LATITUDE,
    LONGITUDE,
    START_LATITUDE,
    START_TIME,
    read_place,
    sample_variables,
    unix_milliseconds,
    unix_seconds,
)
from twin.records.mission_dataset import STATES, dataset_of, signal_names, stored_columns
from twin.records.schema import MISSION, TIME, variable
from twin.records.storage.store_arrays import check_mission
from twin.records.storage.store_path import check_addresses, store_path
from twin.records.storage.whole import whole_file
from twin.records.store import declare_signals, read_trajectory, write_netcdf, write_store
from twin.records.trajectory import Trajectory

if TYPE_CHECKING:
    import xarray as xr

ENDINGS = (".zarr", ".nc")


def to_xarray(trajectory: Trajectory) -> xr.Dataset:
    """The signals (time,) in full precision, with units and CF attributes of the schema.

    A mission that knows its place has the coordinates `latitude` and `longitude` (time,); one
    that knows its date has `datetime` (time,).
    """
    import xarray as xr

    signals = {
        name: (TIME, values, variable(name).attributes()) for name, values in trajectory.items()
    }
    coordinates: dict[str, Any] = {}
    if START_LATITUDE in trajectory.provenance and "true_north" in trajectory:
        coordinates |= zip((LATITUDE, LONGITUDE), trajectory.geographic_position(), strict=True)
    if START_TIME in trajectory.provenance:
        start = unix_seconds(trajectory.provenance[START_TIME])
        coordinates[DATETIME] = unix_milliseconds(start, trajectory.time)
    coordinates = sample_variables(coordinates, FLOWN, (TIME,))
    coordinates[TIME] = (TIME, trajectory.time, {"units": "s", "long_name": "time since the start"})
    return xr.Dataset(signals, coordinates, {**SIMULATED_ATTRIBUTES, **_plain(trajectory)})


def save_trajectory(trajectory: Trajectory, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a trajectory with its MuJoCo states: a store of one mission, or the same as netCDF.

    Args:
      path: ends in .zarr or .nc.

    Raises:
      InputError: another ending. WriteError: something is in the way, or the disk refuses.
    """
    check_addresses(path := Path(path))
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise InputError(f"cannot save {path.name!r}: the name must end in {' or '.join(ENDINGS)}")
    dataset = dataset_of([trajectory], attributes=_plain(trajectory))
    if ending == ".zarr":
        return write_store(dataset, path, overwrite=overwrite)
    with whole_file(path, overwrite=overwrite) as place:
        write_netcdf(dataset, place)
    return path


def open_trajectory(path: str | Path, mission: int = 0) -> Trajectory:
    """One mission of a store, or of a netCDF file that `Trajectory.save` wrote.

    Raises:
      StoreError: as `read_trajectory`; or the netCDF file cannot be read or is not ours.
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
            return _read(dataset.load(), path, mission)
    except (OSError, ValueError) as error:
        if isinstance(error, StoreError):
            raise
        raise StoreError(f"file {path} cannot be read: {' '.join(str(error).split())}") from error


def _read(dataset: xr.Dataset, path: Path, mission: int) -> Trajectory:
    if dataset.attrs.get(SCHEMA) != SIMULATED_ATTRIBUTES[SCHEMA] or N_SAMPLES not in dataset:
        raise StoreError(f"{path} holds no mission: `Trajectory.save` writes such files")
    check_mission(mission, dataset.sizes[MISSION], str(path))
    declare_signals(dataset)
    one = dataset.isel({MISSION: mission})
    one = one.isel({TIME: slice(0, int(one[N_SAMPLES]))})
    rows = one[STATES].values if STATES in one else np.zeros((0, 0))
    return Trajectory(
        time=np.asarray(one[TIME].values, float),
        signals={n: np.asarray(one[n].values, float) for n in signal_names(one)},
        states=np.asarray(rows, float),
        state_columns=stored_columns(one),
        provenance={**dataset.attrs, **read_place(one)},
    )


def _plain(trajectory: Trajectory) -> dict[str, Any]:
    """What the trajectory says about itself, as attributes of a file can hold it."""
    return {
        name: value
        for name, value in trajectory.provenance.items()
        if name not in SIMULATED_ATTRIBUTES and isinstance(value, str | int | float)
    }
