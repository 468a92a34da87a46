"""Own file: variables added to a netCDF file that others wrote, all of them or none.

What was in the file stays, byte for byte as it reads. A variable of an earlier run is replaced; a
file that already says the same is left alone.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1 import Og1Variable
from factory.importing import Tally
from factory.importing.netcdf import as_array, attributes_of, open_netcdf, seconds_of
from twin.errors import InputError
from twin.records import whole_file

CLOCK = "time"
"""Name of the times of the samples, with pyglider and with basestation3"""
COORDINATES = (CLOCK, "depth", "latitude", "longitude")
"""Named as coordinates of what is added, where they are along the same dimension"""
OURS = "glider-twin"
"""Beginning of the attribute `source` of added variables"""


def times_of(path: Path) -> NDArray[np.float64]:
    """[s] unix times of the samples, (samples,), NaN for none.

    Raises:
      InputError: no netCDF file.
    """
    with open_netcdf(path) as file:
        clock = file.variables[CLOCK]
        return seconds_of(as_array(clock[:]), attributes_of(clock), path.name, Tally())


def add_variables(path: Path, variables: Mapping[str, Og1Variable]) -> bool:
    """Add variables along the samples of a file; whether it changed.

    Raises:
      InputError: the file has a variable of such a name that is not ours.
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
    """Values as the file has them: with the fill value, in its type."""
    return np.where(np.isnan(one.values), np.array(one.fill), one.values).astype(one.kind)


def _attributes(file: Any, one: Og1Variable) -> dict[str, Any]:
    along = file[CLOCK].dimensions
    named = [
        name for name in COORDINATES
        if name in file.variables and file[name].dimensions == along and along != (name,)
    ]  # fmt: skip
    return {**one.attributes, **({"coordinates": " ".join(named)} if named else {})}


def _same(file: Any, name: str, one: Og1Variable) -> bool:
    """Compare a variable of the file with a new one."""
    if name not in file.variables:
        return False
    said = {key: str(value) for key, value in attributes_of(file[name]).items()}
    wanted = {key: str(value) for key, value in _attributes(file, one).items()}
    said.pop("_FillValue", None)
    return said == wanted and np.array_equal(file[name][:], _stored(one), equal_nan=True)
