"""netCDF-4 and HDF5 files (MATLAB v7.3 among them): opened with errors that say what is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError

Array = NDArray[np.float64]


def open_netcdf(path: Path) -> Any:
    """A netCDF or HDF5 file for reading.

    Raises:
      InputError: it is neither, or truncated.
    """
    import netCDF4

    try:
        return netCDF4.Dataset(path)
    except (OSError, RuntimeError) as error:
        with path.open("rb") as file:
            start = file.read(8)
        known = start.startswith((b"CDF", b"\x89HDF")) or b"MATLAB" in start
        why = "truncated or damaged" if known else "of another format"
        raise InputError(
            f"{path.name} cannot be opened as netCDF-4 or HDF5: {why} ({type(error).__name__})"
        ) from error


def as_array(values: object) -> Array:
    """Any numbers as a float64 array; masked ones are NaN."""
    filled = np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan)
    return np.asarray(filled, np.float64).ravel()


def holds_arrays(path: Path) -> bool:
    """Whether a file is netCDF or HDF5 by its first bytes; MATLAB puts 512 bytes before them."""
    with path.open("rb") as file:
        start = file.read(600)
    return start.startswith((b"CDF", b"\x89HDF")) or start[512:516] == b"\x89HDF"


def variable_names(path: Path) -> list[str]:
    """Names of the variables and groups of a netCDF or HDF5 file; errors as `open_netcdf`."""
    with open_netcdf(path) as file:
        return [*file.variables, *file.groups]
