"""Trajectory file: one trajectory as an xarray dataset, as a zarr store and as netCDF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.bounded import check_dataset
from twin.errors import InputError, StoreError
from twin.records.attributes import N_SAMPLES, SCHEMA, SIMULATED_ATTRIBUTES
from twin.records.place import START_LATITUDE, START_TIME, read_place
from twin.records.schema import MISSION, TIME, variable
from twin.records.store import (
    STATES,
    declare_signals,
    mission_dataset,
    read_trajectory,
    signal_names,
    stored_columns,
    write_store,
)
from twin.records.trajectory import Trajectory

if TYPE_CHECKING:
    import xarray as xr

ENDINGS = (".zarr", ".nc")


def to_xarray(trajectory: Trajectory) -> xr.Dataset:
    """The signals (time,) in full precision, with units and CF attributes of the schema.

    A mission that knows its place has the coordinates `latitude` and `longitude` (time,); one
    that knows its date has `utc` (time,).
    """
    import xarray as xr

    time = (TIME, trajectory.time, {"units": "s", "long_name": "time since the start"})
    signals = {
        name: (TIME, values, variable(name).attributes()) for name, values in trajectory.items()
    }
    coordinates: dict[str, Any] = {TIME: time}
    if START_LATITUDE in trajectory.provenance:
        for name, units, values in zip(
            ("latitude", "longitude"),
            ("degree_north", "degree_east"),
            trajectory.geographic_position(),
            strict=True,
        ):
            coordinates[name] = (TIME, values, {"units": units, "standard_name": name})
    if START_TIME in trajectory.provenance:
        start = np.datetime64(trajectory.provenance[START_TIME], "ns")
        moments = start + np.round(trajectory.time * 1e9).astype("timedelta64[ns]")
        coordinates["utc"] = (TIME, moments, {"standard_name": "time", "long_name": "UTC"})
    return xr.Dataset(signals, coordinates, {**SIMULATED_ATTRIBUTES, **_plain(trajectory)})


def save_trajectory(trajectory: Trajectory, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a trajectory with its MuJoCo states: a store of one mission, or the same as netCDF.

    Args:
      path: ends in .zarr or .nc.

    Raises:
      InputError: another ending. StoreError: something is in the way, or the disk refuses.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise InputError(f"cannot save {path.name!r}: the name must end in {' or '.join(ENDINGS)}")
    dataset = mission_dataset([trajectory], attributes=_plain(trajectory))
    if ending == ".zarr":
        return write_store(dataset, path, overwrite=overwrite)
    if path.exists() and not (overwrite and path.is_file()):
        raise StoreError(f"{path} already exists: use overwrite=True or another name")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        dataset.to_netcdf(path, engine="netcdf4")
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error.strerror or error}") from error
    return path


def open_trajectory(path: str | Path, mission: int = 0) -> Trajectory:
    """One mission of a store, or of a netCDF file that `Trajectory.save` wrote.

    Raises:
      StoreError: as `read_trajectory`; or the netCDF file cannot be read or is not ours.
    """
    path = Path(path)
    if path.suffix.lower() != ".nc":
        return read_trajectory(path, mission)
    import xarray as xr

    if not path.is_file():
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
    if not 0 <= mission < dataset.sizes[MISSION]:
        raise StoreError(f"{path} has missions 0 to {dataset.sizes[MISSION] - 1}, not {mission}")
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
