"""Reader of Spray's binned files: profiles of several missions, in bins of depth.

A file keeps of each dive where and when its middle was (`lat_uv`, `lon_uv`, `time_uv`), and of its
profile, taken on the climb, the same (`lat`, `lon`, `time`): by the files' own comments the latter
is three quarters of the way between the fixes. So the fixes lie twice the difference of the two
before and after the middle of the dive. Bins have no times: the glider is taken to go down and up
evenly, with its turn in the middle of the dive.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import clean
from factory.importing.deployment_log import EMPTY, Channel, DeploymentLog, LoggedFixes, each_file
from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.netcdf import as_array, attributes_of, open_netcdf, seconds_of
from factory.importing.seawater import ctd_channels, pressure_of
from factory.importing.tally import Tally, leave_out, note_unread
from twin.errors import InputError

Array = NDArray[np.float64]

PLACES = ("time", "lat", "lon", "time_uv", "lat_uv", "lon_uv")
"""Middles of a profile and of its dive, (profile,) each"""
CURRENTS = {"dac_east": "u_depth_mean", "dac_north": "v_depth_mean"}
"""[m/s] mean over the depths of a dive, (profile,)"""
WATER = ("temperature", "salinity")
"""(depth, profile) or (profile, depth)"""
OWNERS = ("mission", "trajectory_index")
"""Number of a profile's mission; the first that is there"""
READ = ("depth", *PLACES, *CURRENTS.values(), *WATER, *OWNERS, "trajectory", "profile")
LONGEST = 86400.0
"""[s] No dive of a glider is longer"""
_KIND = "Spray's binned file"


@dataclasses.dataclass(frozen=True, kw_only=True)
class SprayProfiles:
    """One file."""

    numbers: dict[str, Array]
    """(profile,) each"""
    depth: Array
    """[m] of the bins, down"""
    water: dict[str, Array]
    """(profile, bin) each"""


def read_spray(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """One log for each mission in each file.

    Raises:
      WrongFormat: another kind of file.
      InputError: a file is damaged, or no profile of it has a place and a time.
    """
    if options.payload:
        raise InputError("a Spray's bins have no times of their own: leave --payload out")
    logs = []
    for path, found in each_file(paths, lambda path: _file(path, tally), tally):
        owner = found.numbers["owner"]
        for number in np.unique(owner):
            logs.append(_log(f"spray-{number:.0f}", path.name, found, owner == number, tally))
    return logs


def _file(path: Path, tally: Tally) -> SprayProfiles:
    with open_netcdf(path) as file:
        variables = file.variables
        names = [*variables, *file.groups]
        if not {"depth", *PLACES} <= set(variables):
            raise WrongFormat(path, names)
        try:
            numbers = {
                name: as_array(variables[name][:])
                for name in (*PLACES, *CURRENTS.values(), *OWNERS)
                if name in variables
            }
            for name in ("time", "time_uv"):
                said = attributes_of(variables[name])
                numbers[name] = seconds_of(numbers[name], said, f"{path.name} {name}", tally)
            depth = np.abs(as_array(variables["depth"][:]))
            count = len(numbers["time"])
            water = {
                name: _by_profile(variables[name], count, len(depth), path)
                for name in WATER
                if name in variables
            }
        except (RuntimeError, OSError) as error:
            raise InputError(f"{path.name} is damaged: {' '.join(str(error).split())}") from error
    sizes = {name: len(values) for name, values in numbers.items()}
    odd = [name for name, size in sizes.items() if size != count]
    if odd:
        raise InputError(
            f"{path.name}: {odd[0]} has {sizes[odd[0]]} values, time {count}: one belongs to each "
            "profile"
        )
    owner = next((name for name in OWNERS if name in numbers), None)
    numbers["owner"] = np.zeros(count) if owner is None else numbers[owner]
    half = 2.0 * (numbers["time"] - numbers["time_uv"])
    usable = np.isfinite(np.stack([numbers[name] for name in (*PLACES, "owner")])).all(axis=0)
    usable &= (half > 0.0) & (half < 0.5 * LONGEST)
    tally.add("left out", path.name, int((~usable).sum()), "profiles without place or time")
    if not usable.any():
        raise InputError(f"{path.name}: no profile has a place and a time (time, time_uv)")
    note_unread(_KIND, names, READ, tally)
    leave_out(
        [n for n in ("u", "v") if n in names], "a mean over bins, no velocity of a time", tally
    )
    tally.add("read", path.name, int(usable.sum()), "profiles")
    tally.add(
        "note", path.name, int(usable.sum()),
        "fixes are made again of the middles of dive and profile, times of bins of an even climb",
    )  # fmt: skip
    return SprayProfiles(
        numbers={name: values[usable] for name, values in numbers.items()},
        depth=depth,
        water={name: values[usable] for name, values in water.items()},
    )


def _by_profile(variable: Any, profiles: int, bins: int, path: Path) -> Array:
    values = as_array(variable[:]).reshape(variable.shape)
    if values.shape == (bins, profiles):
        return values.T
    if values.shape == (profiles, bins):
        return values
    raise InputError(
        f"{path.name}: {variable.name} is {values.shape}, not {bins} depths of {profiles} profiles"
    )


def _log(
    name: str, file: str, found: SprayProfiles, mine: NDArray[np.bool_], tally: Tally
) -> DeploymentLog:
    order = np.flatnonzero(mine)[np.argsort(found.numbers["time_uv"][mine])]
    numbers = {key: values[order] for key, values in found.numbers.items()}
    middle = numbers["time_uv"]
    half = 2.0 * (numbers["time"] - middle)
    sides = np.array([-2.0, 2.0])
    latitude, longitude = (
        (numbers[f"{axis}_uv"][:, None] + sides * (numbers[axis] - numbers[f"{axis}_uv"])[:, None])
        for axis in ("lat", "lon")
    )
    fixes = _rising(
        (middle[:, None] + np.array([-1.0, 1.0]) * half[:, None]).ravel(),
        latitude.ravel(), longitude.ravel(),
    )  # fmt: skip
    sampled = {key: values[order] for key, values in found.water.items()}
    times, depths, rows = [], [], []
    for row in range(len(order)):
        there = np.isfinite(np.stack([v[row] for v in sampled.values()])).any(axis=0)
        bins = np.sort(found.depth[there]) if there.any() else found.depth[:0]
        if not len(bins):
            continue
        down = np.concatenate([[0.0], bins / bins[-1]])
        for side in (-1.0, 1.0):
            part = down if side < 0.0 else down[::-1][1:]
            times.append(middle[row] + side * half[row] * (1.0 - part))
            depths.append(part * bins[-1])
            rows.append(np.full(len(part), row if side > 0.0 else -1))
    if not times:
        raise InputError(f"{file}: no profile of {name} has temperature or salinity")
    time, depth, of = _rising(*(np.concatenate(each) for each in (times, depths, rows)))
    channels = {"measured_depth": clean("measured_depth", time, depth, tally, subject=file)}
    up = (of >= 0) & (depth > 0.0)
    at = np.searchsorted(np.sort(found.depth), depth[up] - 1e-6)
    column = np.argsort(found.depth)[np.minimum(at, len(found.depth) - 1)]
    water = {key: values[of[up].astype(int), column] for key, values in sampled.items()}
    known = LoggedFixes(*fixes)
    if "temperature" in water:
        north, east = known.at(time[up])
        channels |= ctd_channels(
            time[up],
            temperature=water["temperature"],
            pressure=pressure_of(depth[up], north),
            practical=water.get("salinity"),
            latitude=north,
            longitude=east,
            tally=tally,
        )
    return DeploymentLog(
        deployment=name,
        platform="Spray",
        channels={key: channel for key, channel in channels.items() if len(channel)},
        fixes=known,
        magnetic_variation=EMPTY,
        auxiliary=_reported(numbers, middle + half),
        files=(file,),
        station=True,
    )


def _reported(numbers: Mapping[str, Array], end: Array) -> dict[str, Channel]:
    """The current of each dive, known at its end."""
    found = {}
    for target, name in CURRENTS.items():
        if name in numbers:
            there = np.isfinite(numbers[name])
            found[target] = Channel(*_rising(end[there], numbers[name][there]))
    return {target: one for target, one in found.items() if len(one)}


def _rising(time: Array, *columns: Array) -> tuple[Array, ...]:
    """Sorted by time, each time once."""
    time, first = np.unique(time, return_index=True)
    return (time, *(column[first] for column in columns))
