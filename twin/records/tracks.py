"""Tracks: dead-reckoned tracks read from a file, for figures that show them beside the true track.

One file holds any number of named tracks. The ending of the file's name selects the format:

- `.nc`, `.zarr`: an xarray dataset with variables `<name>_north` and `<name>_east` [m], dims
  (mission, time) or (time), and a coordinate `time` [s]. The mission is looked up in a coordinate
  `mission` if there is one; else the mission is the row's number. Files of `twin flight` give
  their corrected track `north` and `east`.
- `.npz`: arrays with the same names, (time,) or (mission, time), `time` and optionally `mission`.
- `.csv`: a header with columns `time`, `north`, `east` and optionally `track` (the name) and
  `mission`; one row per sample, in time order within each track.

Positions are metres north and east of the mission's start; time is seconds since its start.
"""

from __future__ import annotations

import dataclasses
import warnings
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from twin.bounded import check_archive, check_dataset
from twin.errors import InputError, unknown_name
from twin.numbers import Array
from twin.records.attributes import TITLE, is_missions
from twin.records.presence import FLIGHT_TITLE
from twin.records.schema import MISSION, TIME
from twin.records.storage.checksums import check_readable
from twin.records.storage.store_path import check_addresses
from twin.records.store import write_netcdf, write_zarr

if TYPE_CHECKING:
    import pandas as pd


NORTH, EAST = "_north", "_east"
"""Endings of the names of a track's two variables"""
CORRECTED = "corrected"
"""Name of the track from a file of `twin flight`"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NamedTrack:
    """Horizontal track with its name for legends."""

    name: str
    time: Array
    """[s] since the mission's start, increasing, shape (time,)"""
    north: Array
    """[m] from the start, shape (time,)"""
    east: Array
    """[m] from the start, shape (time,)"""

    def __post_init__(self) -> None:
        shapes = {a.shape for a in (self.time, self.north, self.east)}
        if len(shapes) != 1 or self.time.ndim != 1 or len(self.time) < 2:
            raise InputError(
                f"track {self.name!r}: time, north and east must be of one shape (time,) with at "
                f"least 2 samples, got {', '.join(str(s) for s in sorted(shapes))}"
            )
        if not (np.diff(self.time) > 0).all():
            raise InputError(f"track {self.name!r}: its times must increase")

    @property
    def title(self) -> str:
        """The name with spaces instead of underscores."""
        return self.name.replace("_", " ")

    def at(self, time: Array) -> tuple[Array, Array]:
        """Interpolate north and east [m] at `time` [s]; NaN outside the track."""
        return (
            np.interp(time, self.time, self.north, left=np.nan, right=np.nan),
            np.interp(time, self.time, self.east, left=np.nan, right=np.nan),
        )


def read_tracks(path: Path | str, mission: int = 0) -> list[NamedTrack]:
    """Read the tracks of `mission` from the file at `path`, in the file's order.

    Raises:
      InputError: no such file or mission, unknown format, missing or malformed columns.
    """
    check_addresses(path := Path(path))
    if not path.exists():
        raise InputError(f"no track file at {path}")
    readers: dict[str, Callable[[Path, int], list[NamedTrack]]] = {
        ".csv": _read_csv, ".nc": _read_dataset, ".npz": _read_npz, ".zarr": _read_dataset,
    }  # fmt: skip
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"track file {path.name}: the ending must be one of {', '.join(readers)}")
    check_readable(path)
    tracks = reader(path, mission)
    if not tracks:
        raise InputError(
            f"track file {path.name}: no track of mission {mission}; it needs variables "
            f"NAME{NORTH} and NAME{EAST}, or CSV columns time, north, east"
        )
    return tracks


def choose_tracks(tracks: Sequence[NamedTrack], names: str | None) -> list[NamedTrack]:
    """Choose the tracks named in `names` (separated by commas), in that order; None takes all.

    Raises:
      InputError: no track has one of the names.
    """
    if names is None:
        return list(tracks)
    by_name = {track.name: track for track in tracks}
    wanted = dict.fromkeys(name.strip() for name in names.split(","))
    for name in wanted:
        if name not in by_name:
            raise InputError(unknown_name("track", name, by_name))
    return [by_name[name] for name in wanted]


def _read_dataset(path: Path, mission: int) -> list[NamedTrack]:
    import xarray

    try:
        dataset = xarray.open_dataset(path, engine="zarr" if path.suffix == ".zarr" else None)
    except (OSError, ValueError) as error:
        raise InputError(f"track file {path.name} cannot be read: {error}") from error
    with dataset:
        check_dataset(dataset, path, f"track file {path.name}")
        if is_missions(dataset.attrs):
            raise InputError(
                f"{path} is a store of missions, not a file of dead-reckoned tracks; `learn "
                "evaluate --tracks FILE` writes one"
            )
        if TIME in dataset and dataset[TIME].dtype.kind not in "iuf":
            raise InputError(
                f"track file {path.name}: its time is of dates; give seconds since the mission's "
                "start"
            )
        arrays = {
            str(n): np.asarray(dataset[n].values, float)
            for n in dataset.variables
            if n in (TIME, MISSION) or (str(n).endswith((NORTH, EAST)) and TIME in dataset[n].dims)
        }
        if str(dataset.attrs.get(TITLE, "")).startswith(FLIGHT_TITLE):
            arrays |= {
                f"{CORRECTED}_{n}": np.asarray(dataset[n].values, float) for n in ("north", "east")
            }
    return _collect(arrays, mission, path)


def write_track_dataset(
    path: Path, missions: Array, time: Array, arrays: Mapping[str, Array]
) -> None:
    """Write tracks as netCDF if the name ends in .nc, else as zarr.

    Args:
      path: path from `whole_file`, or folder from `whole_folder` for zarr.
      missions: numbers of the missions, (mission,).
      time: [s] since each mission's start, (time,).
      arrays: `<name>_north` and `<name>_east` [m], (mission, time).
    """
    import xarray as xr

    dataset = xr.Dataset(
        {
            name: ((MISSION, TIME), values, {"units": "m", "long_name": name.replace("_", " ")})
            for name, values in arrays.items()
        },
        {MISSION: missions, TIME: (TIME, time, {"units": "s"})},
        {TITLE: "Dead-reckoned tracks, metres from each mission's start"},
    )
    if path.suffix == ".nc":
        write_netcdf(dataset, path)
    else:
        write_zarr(dataset, path)


def _read_npz(path: Path, mission: int) -> list[NamedTrack]:
    check_archive(path, f"track file {path.name}")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name], float) for name in file.files}
    except (OSError, ValueError, TypeError, EOFError, MemoryError, BadZipFile, zlib.error) as error:
        raise InputError(f"track file {path.name} cannot be read: {error}") from error
    return _collect(arrays, mission, path)


def _collect(arrays: Mapping[str, Array], mission: int, path: Path) -> list[NamedTrack]:
    if "time" not in arrays:
        raise InputError(f"track file {path.name}: no variable 'time' [s]")
    tracks = []
    for name in (n.removesuffix(NORTH) for n in arrays if n.endswith(NORTH)):
        if name + EAST not in arrays:
            raise InputError(f"track file {path.name}: {name}{NORTH} lacks its {name}{EAST}")
        north, east, time = (
            _row(arrays[n], arrays.get("mission"), mission, path)
            for n in (name + NORTH, name + EAST, "time")
        )
        tracks.append(_finite(name, time, north, east))
    return tracks


def _row(values: Array, missions: Array | None, mission: int, path: Path) -> Array:
    """Return the mission's row of an array with a mission axis; else return the whole array."""
    if values.ndim == 1:
        return values
    index = mission
    if missions is not None and missions.shape == values.shape[:1]:
        found = np.flatnonzero(missions == mission)
        index = int(found[0]) if len(found) else -1
    if not 0 <= index < len(values):
        known = "" if missions is None else f" (it holds {', '.join(f'{m:g}' for m in missions)})"
        raise InputError(f"track file {path.name}: no mission {mission}{known}")
    return np.asarray(values[index])


def _read_csv(path: Path, mission: int) -> list[NamedTrack]:
    import pandas as pd

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # pandas would drop cells
            frame = pd.read_csv(
                path, dtype=str, na_filter=False, skipinitialspace=True, index_col=False
            )
    except (OSError, ValueError, pd.errors.ParserWarning) as error:
        why = " ".join(str(error).split())
        raise InputError(f"track file {path.name} cannot be read: {why}") from error
    missing = {"time", "north", "east"} - set(frame.columns)
    if missing:
        raise InputError(f"track file {path.name}: no column {', '.join(sorted(missing))}")
    if "mission" in frame:
        chosen = _csv_numbers(frame["mission"].replace("", str(mission)), path)
        frame = frame[chosen == mission]
    names = frame["track"].replace("", path.stem) if "track" in frame else path.stem
    numbers = frame[["time", "north", "east"]].apply(_csv_numbers, path=path)
    grouped = numbers.groupby(names, sort=False) if "track" in frame else [(names, numbers)]
    return [_finite(str(name), *rows.to_numpy().T) for name, rows in grouped if len(rows)]


def _csv_numbers(cells: pd.Series[str], path: Path) -> pd.Series[float]:
    """Convert the cells of a column to numbers; an error names the first line without a number."""
    import pandas as pd

    try:
        return cells.astype(float)
    except ValueError:
        numbers = pd.to_numeric(cells, errors="coerce")
        first = cells[numbers.isna() & (cells.str.lower() != "nan")]
        raise InputError(
            f"track file {path.name}, line {first.index[0] + 2}: {cells.name} is "
            f"{first.iloc[0]!r}, not a number"
        ) from None


def _finite(name: str, time: Array, north: Array, east: Array) -> NamedTrack:
    """The track without the NaN padding that stores have."""
    if not time.shape == north.shape == east.shape:
        raise InputError(
            f"track {name!r}: {north.shape} north, {east.shape} east, {time.shape} time "
            "must be of one shape"
        )
    keep = np.isfinite(time) & np.isfinite(north) & np.isfinite(east)
    return NamedTrack(name=name, time=time[keep], north=north[keep], east=east[keep])
