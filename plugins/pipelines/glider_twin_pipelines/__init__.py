"""Pipelines: results of a flight model in the netCDF files of pyglider and basestation3.

from glider_twin_pipelines import add_flight

add_flight("L0-timeseries/dfo-eva035-20190718.nc", vehicle="mine.xml")
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

from factory.importing import sniff
from glider_twin_pipelines.modelled_log import modelled
from glider_twin_pipelines.own_file import add_variables, times_of
from twin.errors import InputError

KINDS = {
    "ngdac": "a time series of pyglider",
    "seaglider": "a dive of basestation3",
}
"""Kinds of files that are added to, by the names of `factory import`"""


def add_flight(path: str | Path, vehicle: str | None = None) -> bool:
    """Add what a flight model says to a time series of pyglider; whether the file changed.

    Args:
      path: what `raw_to_timeseries` or `binary_to_timeseries` wrote.
      vehicle: what `twin identify` wrote, or the name of a shipped vehicle; default the shipped one
        of the log's kind.

    Raises:
      InputError: another kind of file, one without what a flight model reads, or one that has a
        variable of such a name by others; it says which. VehicleError: no such vehicle.
      WriteError: the disk refuses. The file is as it was after every error.
    """
    return bool(add_flights([path], vehicle))


def add_flights(
    paths: Sequence[str | Path],
    vehicle: str | None = None,
    write: Sequence[str | Path] | None = None,
) -> list[Path]:
    """Add what a flight model says to files of one deployment; those that changed.

    Args:
      paths: dives of one Seaglider by basestation3, which are read together, or one time series of
        pyglider.
      vehicle: as `add_flight`.
      write: those of them that are added to, all by default; the rest are only read, since a track
        is the surer the more fixes are on either side.

    Raises:
      InputError, VehicleError, WriteError: as `add_flight`. Files before the one that fails are
        done.
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
