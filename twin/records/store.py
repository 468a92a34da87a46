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
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.bounded import check_dataset, parse_json
from twin.errors import InputError, StoreError, WriteError
from twin.records.attributes import (
    N_SAMPLES,
    PROGRAM_VERSION,
    SETTINGS,
    SIMULATED_ATTRIBUTES,
    VERSION,
    is_missions,
)
from twin.records.checksums import is_listed
from twin.records.flight_file import flight_message, is_flight
from twin.records.object_files import files_at
from twin.records.place import (
    COORDINATES,
    FLOWN,
    NOMINAL,
    PLACE,
    flown_coordinates,
    nominal_array,
    padded,
    place_arrays,
    read_place,
    sample_variables,
)
from twin.records.schema import MISSION, SCHEMA_VERSION, TIME, VARIABLES, declare_stored
from twin.records.sharded import METADATA
from twin.records.store_path import StorePath, store_path
from twin.records.trajectory import Trajectory
from twin.records.whole import check_folder_target, recover, whole_folder

if TYPE_CHECKING:
    import xarray as xr

STATE, STATES = "state", "simulation_state"
COLUMNS = "columns"
"""Attribute of `simulation_state` that names its columns: qpos, qvel, act, ctrl (x north, y west, z
up; SI, rad, cm3)."""

GENERATING = ".generating"
"""Ending of the folder beside a store that `factory generate` works in until it is complete."""
RECIPE = "recipe.json"
"""In a folder of it: what the store is made by"""
UNFINISHED = ".generating"
"""Folder inside a store that an older factory has begun and not completed."""
LONGEST_VERSION = 40
"""Characters of the version of a program, as messages quote it"""


def mission_dataset(
    trajectories: Sequence[Trajectory],
    *,
    parameters: Sequence[Mapping[str, float]] | None = None,
    attributes: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """The trajectories as one dataset of the schema, padded with NaN to the longest."""
    import xarray as xr

    longest = max(len(t.time) for t in trajectories)
    provenances = [t.provenance for t in trajectories]
    coordinates: dict[str, Any] = {
        MISSION: (MISSION, np.arange(len(trajectories)), {"long_name": "mission index"}),
        TIME: (
            TIME,
            max((t.time for t in trajectories), key=len),
            {"units": "s", "long_name": "time since the start of the mission"},
        ),
    }
    variables: dict[str, Any] = {
        N_SAMPLES: (
            MISSION,
            np.array([len(t.time) for t in trajectories], np.int32),
            {
                "units": "1",
                "long_name": "number of samples of the mission",
                "comment": "later ones are padding",
            },
        )
    }
    variables |= nominal_array(provenances)
    if places := place_arrays(provenances):
        positions = [flown_coordinates(t.time, *_true_track(t), t.provenance) for t in trajectories]
        samples = {
            name: padded(name, [p[name] for p in positions], longest) for name in COORDINATES
        }
        coordinates |= sample_variables(samples, FLOWN, (MISSION, TIME)) | places
    for name, entry in VARIABLES.items():
        if not any(name in t.signals for t in trajectories):
            continue
        values = np.full((len(trajectories), longest), np.nan, np.float32)
        for i, trajectory in enumerate(trajectories):
            if name in trajectory.signals:
                values[i, : len(trajectory.time)] = trajectory.signals[name]
        variables[name] = ((MISSION, TIME), values, entry.attributes())
    width = _state_width(trajectories)
    states = np.full((len(trajectories), longest, width), np.nan)
    for i, trajectory in enumerate(trajectories):
        states[i, : len(trajectory.time)] = trajectory.states
    variables[STATES] = (
        (MISSION, TIME, STATE),
        states,
        {
            "units": "1",
            "long_name": "exact MuJoCo state, for replay and rendering",
            COLUMNS: " ".join(trajectories[0].state_columns),
        },
    )
    said = {n: value for n, value in (attributes or {}).items() if n not in (*PLACE, NOMINAL)}
    dataset = xr.Dataset(variables, coordinates, {**SIMULATED_ATTRIBUTES, **said})
    for name in sorted({key for row in parameters or () for key in row}):
        values = np.array([row.get(name, np.nan) for row in parameters or ()])
        dataset[name] = (MISSION, values)
    return dataset


def _true_track(trajectory: Trajectory) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """North and east [m], (time,); NaN where the trajectory was logged and nobody knows them."""
    unknown = np.full(len(trajectory.time), np.nan)
    north, east = (trajectory.signals.get(f"true_{name}", unknown) for name in ("north", "east"))
    return north, east


def _state_width(trajectories: Sequence[Trajectory]) -> int:
    """Columns of their states; raises StoreError when they are those of different vehicles."""
    first = trajectories[0]
    for index, other in enumerate(trajectories):
        alike = other.state_columns == first.state_columns
        if not (alike and other.states.shape[1:] == first.states.shape[1:]):
            raise StoreError(
                f"a store holds the missions of one kind of vehicle: trajectory {index} has the "
                f"parts {', '.join(other.actuators) or 'none'}, trajectory 0 has "
                f"{', '.join(first.actuators) or 'none'}; write a store for each"
            )
    return int(first.states.shape[1])


def stored_columns(one: xr.Dataset) -> tuple[str, ...]:
    """Names of the columns of a dataset's states; empty when it has none."""
    return tuple(str(one[STATES].attrs.get(COLUMNS, "")).split()) if STATES in one else ()


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


def write_zarr(dataset: xr.Dataset, folder: Path) -> None:
    """Write any dataset as a zarr v3 group that `xarray.open_zarr(path)` opens without options.

    Each chunk has a CRC-32C, so that whatever reads a changed one fails. `folder` is one of
    `whole_folder`: a kill leaves part of the group.
    """
    from zarr.codecs import Crc32cCodec, ZstdCodec

    codecs = {"compressors": [ZstdCodec(), Crc32cCodec()]}
    encoding = dict.fromkeys(dataset.variables, codecs)
    with warnings.catch_warnings():
        # zarr 3 warns that its specification does not name consolidated metadata yet
        warnings.filterwarnings("ignore", "Consolidated metadata")
        dataset.to_zarr(folder, mode="w", zarr_format=3, consolidated=True, encoding=encoding)


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
    """Refuse a store's name that ends as a file of another format does.

    Raises:
      WriteError: it does.
    """
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


def is_store(path: str | StorePath) -> bool:
    """Whether `path` is a folder that holds a zarr v3 group of missions, whatever else it lacks."""
    try:
        return is_missions(read_attributes(path))
    except StoreError:
        return False


def is_derived(path: str | StorePath) -> bool:
    """Whether `path` is a zarr group that this program wrote and that holds no missions, such as
    tracks: what may take its place must not take that of a store."""
    return is_complete(path) and is_listed(path) and not is_store(path)


def is_complete(path: str | StorePath) -> bool:
    """Whether `path` holds a zarr v3 group; a store has its metadata only once it is complete."""
    return files_at(path).exists(METADATA)


def generating(path: str | StorePath) -> StorePath:
    """The folder beside a store that `factory generate` works in."""
    place = store_path(path)
    return place.with_name(place.name + GENERATING)


def begun(path: str | StorePath) -> list[StorePath]:
    """Folders, one of each recipe, of runs that were begun for a store and not completed."""
    place = generating(path)
    files = files_at(place)
    return [place / name for name in files.folders() if files.exists(f"{name}/{RECIPE}")]


def is_unfinished(path: str | StorePath) -> bool:
    """Whether `factory generate` has begun a store at `path` and not completed it."""
    return not is_complete(path) and (begun_within(path) or bool(begun(path)))


def begun_within(path: str | StorePath) -> bool:
    """Whether an older factory has begun a store at `path`, and in it, and not completed it."""
    return not is_complete(path) and UNFINISHED in files_at(path).folders()


def read_attributes(path: str | StorePath) -> dict[str, Any]:
    """The attributes of a store, without opening its arrays.

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


def open_store(path: str | StorePath, *, dask: bool = True) -> xr.Dataset:
    """Open a store lazily.

    Args:
      dask: whether its arrays are dask's, in chunks of the store's own, where that is installed;
        else an array is read when it is asked for.

    Raises:
      StoreError: missing, not a store of this schema, or written by a newer version.
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
            f"no store at {path}; make one with `factory generate --out {path}`, or of logs with "
            f"`factory import KIND FILES --out {path}`"
        )
    if not is_complete(path):
        raise StoreError(_no_store(path))
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


def is_there(path: StorePath) -> bool:
    """Whether anything is under a path or below an address; raises OSError."""
    return path.exists() if isinstance(path, Path) else any(files_at(path).all_keys())


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


def signal_names(one: xr.Dataset) -> tuple[str, ...]:
    """The signals of a dataset in the schema's order, parts in that of the vehicle.

    Which part this process met first, perhaps of another vehicle, must not tell in the order.
    """
    names = [name for name in VARIABLES if name in one]
    parts = [c.removeprefix("act_") for c in stored_columns(one) if c.startswith("act_")]
    for prefix in ("true", "commanded"):
        ordered = [f"{prefix}_{part}" for part in parts if f"{prefix}_{part}" in names]
        places = sorted(map(names.index, ordered))
        for place, name in zip(places, ordered, strict=True):
            names[place] = name
    return tuple(names)


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
    samples = _samples(one, path, mission)
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


def check_mission(mission: int, count: int, what: str) -> None:
    """Raise StoreError when there is no such mission among `count`, or none at all.

    Args:
      what: the store or file, for the error.
    """
    check_filled(count, what)
    if not 0 <= mission < count:
        raise StoreError(f"{what} has missions 0 to {count - 1}, not {mission}")


def check_filled(count: int, what: str) -> None:
    """Raise StoreError when `count`, the missions of a store or file, is zero."""
    if count == 0:
        raise StoreError(f"{what} holds no missions; make some with `factory generate`")


def gone_arrays(dataset: xr.Dataset, path: str | StorePath) -> list[str]:
    """Arrays that the store's metadata name and whose files are gone: they would read as NaN.

    Args:
      dataset: as `open_store` gave it.
    """
    files = files_at(path)
    return [name for name in map(str, dataset.variables) if not files.exists(f"{name}/{METADATA}")]


def check_arrays(dataset: xr.Dataset, path: str | StorePath) -> None:
    """Raise StoreError that names the first of `gone_arrays`, when there is one."""
    for name in gone_arrays(dataset, path)[:1]:
        raise StoreError(f"store {path} is damaged: its array {name} is gone; make it again")


def _samples(one: xr.Dataset, path: str | StorePath, mission: int) -> int:
    """The number of samples of a mission, which must fit the store's arrays."""
    if N_SAMPLES not in one:
        raise StoreError(f"store {path} is damaged: it has no array {N_SAMPLES}")
    samples = int(np.nan_to_num(read_array(one, N_SAMPLES, path), nan=0.0))
    if not 0 < samples <= one.sizes[TIME]:
        raise StoreError(
            f"store {path} is damaged: mission {mission} has {samples} of at most "
            f"{one.sizes[TIME]} samples"
        )
    return samples


def read_array(dataset: xr.Dataset, name: str, path: str | StorePath) -> np.ndarray:
    """An array of a store that `open_store` opened, or of some of its missions.

    Raises:
      StoreError: its files are gone or cannot be decoded.
    """
    if not files_at(path).exists(f"{name}/{METADATA}"):
        raise StoreError(f"store {path} is damaged: its array {name} is gone; make it again")
    try:
        return np.asarray(dataset[name].values)
    except Exception as error:  # whatever a decoder raises means damaged files
        why = " ".join(str(error).split()) or type(error).__name__
        raise StoreError(
            f"store {path} is damaged: its array {name} cannot be read ({why}); make it again, or "
            "bring back its files from a copy"
        ) from error
