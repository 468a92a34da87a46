"""Pipelines: add results of a flight model to the netCDF files of pyglider and basestation3.

from glider_twin_pipelines import add_flight

add_flight("L0-timeseries/dfo-eva035-20190718.nc", vehicle="mine.xml")

A file gets all variables or none. Its other content keeps its values bit for bit. Variables from
an earlier run are replaced, and a file with equal variables is not written again.
"""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1 import Og1Variable
from factory.importing import Tally, sniff
from factory.importing.netcdf import as_array, attributes_of, open_netcdf, seconds_of
from glider_twin_pipelines.modelled_log import modelled
from twin.errors import InputError
from twin.records import whole_file

KINDS = {
    "ngdac": "a time series of pyglider",
    "seaglider": "a dive of basestation3",
}
"""Supported files in words, by their format's name in `factory import`"""
CLOCK = "time"
"""Name of the variable of sample times in files of pyglider and basestation3"""
COORDINATES = (CLOCK, "depth", "latitude", "longitude")
"""Variables that are named as coordinates of added variables, if they have the same dimension"""
OURS = "glider-twin"
"""Prefix of the attribute `source` of added variables"""


def add_flight(path: str | Path, vehicle: str | None = None) -> bool:
    """Add a flight model's results to a time series of pyglider; returns True if the file changed.

    Args:
      path: file that `raw_to_timeseries` or `binary_to_timeseries` wrote.
      vehicle: file that `twin identify` wrote, or the name of a shipped vehicle; None takes the
        shipped vehicle for the log's type.

    Raises:
      InputError: the file has another format, lacks a flight model's inputs, or has a variable of
        an added name from another program (named). VehicleError: the vehicle is missing.
      WriteError: the disk refuses. After every error the file is unchanged.
    """
    return bool(add_flights([path], vehicle))


def add_flights(
    paths: Sequence[str | Path],
    vehicle: str | None = None,
    write: Sequence[str | Path] | None = None,
) -> list[Path]:
    """Add a flight model's results to files of one deployment; returns the changed files.

    Args:
      paths: dives of one Seaglider by basestation3, which are read together, or one time series of
        pyglider.
      vehicle: see `add_flight`.
      write: files among `paths` to add to; None takes all. The others are only read: fixes before
        and after a dive make its track more accurate.

    Raises:
      InputError, VehicleError, WriteError: as in `add_flight`. Files before the one that fails are
        changed.
    """
    files = [Path(path) for path in paths]
    chosen = files if write is None else [Path(path) for path in write]
    strange = next((path for path in chosen if path not in files), None)
    if strange is not None or not files:
        raise InputError(f"{strange or 'no file'} is not one of the files that are read; name it")
    kinds = {sniff(path): path for path in files}
    for kind, path in kinds.items():
        if kind not in KINDS:
            raise InputError(f"{path} is none of {', '.join(KINDS.values())}")
    if len(kinds) > 1 or ("ngdac" in kinds and len(files) > 1):
        raise InputError(
            f"{len(files)} files at once: dives of one Seaglider by basestation3 are read "
            "together, a time series of pyglider alone"
        )
    logs = modelled(str(next(iter(kinds))), files, vehicle)
    if len(logs) > 1:
        names = ", ".join(log.deployment for log in logs)
        raise InputError(f"the files are of several vehicles, {names}; name those of one")
    if logs[0].doubt:
        warnings.warn(f"{logs[0].doubt}; identify one and give it as the vehicle", stacklevel=2)
    return [path for path in chosen if add_variables(path, logs[0].at(times_of(path)))]


def times_of(path: Path) -> NDArray[np.float64]:
    """[s] Unix times of the samples, (samples,); NaN for missing times.

    Raises:
      InputError: the file is no netCDF file.
    """
    with open_netcdf(path) as file:
        clock = file.variables[CLOCK]
        return seconds_of(as_array(clock[:]), attributes_of(clock), path.name, Tally())


def add_variables(path: Path, variables: Mapping[str, Og1Variable]) -> bool:
    """Add variables along the samples of a file; returns True if the file changed.

    Raises:
      InputError: the file has a variable of an added name from another program.
      WriteError: the disk refuses.
    """
    with open_netcdf(path) as file:
        file.set_auto_maskandscale(False)
        others = [
            name for name in variables if name in file.variables
            and not str(getattr(file[name], "source", "")).startswith(OURS)
        ]  # fmt: skip
        if others:
            raise InputError(
                f"{path} has {', '.join(others)} already, which glider-twin did not write; "
                "nothing was added"
            )
        if all(_same(file, name, one) for name, one in variables.items()):
            return False
    with whole_file(path) as place:
        shutil.copyfile(path, place)
        with netCDF4.Dataset(place, "a") as file:
            file.set_auto_maskandscale(False)
            packs = not file.data_model.startswith("NETCDF3")
            for name, one in variables.items():
                if name not in file.variables:
                    along, kind = file[CLOCK].dimensions, np.dtype(one.kind)
                    file.createVariable(name, kind, along, zlib=packs, fill_value=one.fill)
                about = _attributes(file, one)
                for word in set(file[name].ncattrs()) - {*about, "_FillValue"}:
                    file[name].delncattr(word)
                file[name].setncatts(about)
                file[name][:] = _stored(one)
    return True


def _stored(one: Og1Variable) -> NDArray[Any]:
    """Values for the file: in the variable's type, with the fill value for NaN."""
    return np.where(np.isnan(one.values), np.array(one.fill), one.values).astype(one.kind)


def _attributes(file: Any, one: Og1Variable) -> dict[str, Any]:
    along = file[CLOCK].dimensions
    named = [
        name for name in COORDINATES
        if name in file.variables and file[name].dimensions == along and along != (name,)
    ]  # fmt: skip
    return {**one.attributes, **({"coordinates": " ".join(named)} if named else {})}


def _same(file: Any, name: str, one: Og1Variable) -> bool:
    """True if the file has the variable with equal values and attributes."""
    if name not in file.variables:
        return False
    said = {key: str(value) for key, value in attributes_of(file[name]).items()}
    wanted = {key: str(value) for key, value in _attributes(file, one).items()}
    said.pop("_FillValue", None)
    return said == wanted and np.array_equal(file[name][:], _stored(one), equal_nan=True)
