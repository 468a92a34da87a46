"""Reader of Spray's binned files: profiles of several missions, in bins of depth.

A file keeps of each dive where and when its middle was (`lat_uv`, `lon_uv`, `time_uv`), and of its
profile, taken on the climb, the same (`lat`, `lon`, `time`): by the files' own comments the latter
is three quarters of the way between the fixes. So the fixes lie twice the difference of the two
before and after the middle of the dive. Bins have no times: the glider is taken to go down and up
evenly, with its turn in the middle of the dive.

OG1.0 files of the Spray data center have the samples of the climb in a row each, and the times of
dive and profile are repeated for them.
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
from factory.importing.netcdf import (
    as_array,
    attributes_of,
    open_netcdf,
    seconds_of,
    text_of,
    unit_in,
    values_in,
)
from factory.importing.seawater import ctd_channels, pressure_of
from factory.importing.tally import Tally, leave_out, note_unread
from factory.importing.units import PRACTICAL, declared
from twin.errors import InputError

Array = NDArray[np.float64]

PLACES = ("time", "lat", "lon", "time_uv", "lat_uv", "lon_uv")
"""Middles of a profile and of its dive, (profile,) each"""
CURRENTS = {"dac_east": "u_depth_mean", "dac_north": "v_depth_mean"}
"""[m/s] mean over the depths of a dive, (profile,)"""
WATER = ("temperature", "salinity")
"""(depth, profile) or (profile, depth)"""
UNITS = {
    "depth": "m", "temperature": "degree_Celsius", "salinity": PRACTICAL,
    **dict.fromkeys(("lat", "lon", "lat_uv", "lon_uv"), "degree"),
    **dict.fromkeys(CURRENTS.values(), "m s-1"),
}  # fmt: skip
"""What variables are converted to by the units that a file declares"""
OWNERS = ("mission", "trajectory_index")
"""Number of a profile's mission; the first that is there"""
READ = ("depth", *PLACES, *CURRENTS.values(), *WATER, *OWNERS, "trajectory", "profile")
ROW = "n_measurements"
"""Dimension of OG1.0, in small letters as its names are compared here"""
NUMBER = "profile_index"
"""Number of the profile of each row of OG1.0"""
IN_ROWS = {
    "time": "time_profile", "lat": "latitude_profile", "lon": "longitude_profile",
    "time_uv": "time_uv", "lat_uv": "latitude_uv", "lon_uv": "longitude_uv",
    "u_depth_mean": "wcur_x", "v_depth_mean": "wcur_y",
    "depth": "depth", "temperature": "temp", "salinity": "psal",
}  # fmt: skip
"""Names of OG1.0, in small letters, by those of binned files"""
_BAD = (3.0, 4.0, 9.0)
"""Flags: probably bad, bad, missing"""
LONGEST = 86400.0
"""[s] No dive of a glider is longer"""
_KIND = "Spray's binned file"


@dataclasses.dataclass(frozen=True, kw_only=True)
class SprayProfiles:
    """One file."""

    numbers: dict[str, Array]
    """(profile,) each"""
    depth: Array
    """[m] of the bins, down, (profile, bin); NaN behind the last"""
    water: dict[str, Array]
    """(profile, bin) each"""
    deployment: str | None = None
    """Name, where the file is one deployment"""


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
            name = found.deployment or f"spray-{number:.0f}"
            logs.append(_log(name, path.name, found, owner == number, tally))
    return logs


def _file(path: Path, tally: Tally) -> SprayProfiles:
    with open_netcdf(path) as file:
        variables = file.variables
        names = [*variables, *file.groups]
        ours = {name.lower(): name for name in variables}
        if NUMBER in ours and {IN_ROWS[name] for name in ("depth", *PLACES)} <= set(ours):
            return _rows(file, path, ours, tally)
        if not {"depth", *PLACES} <= set(variables):
            why = f"a Spray's binned file has depth, {', '.join(PLACES)}"
            raise WrongFormat(path, names, why=why)
        try:
            numbers = {
                name: values
                for name in (*PLACES, *CURRENTS.values(), *OWNERS)
                if name in variables
                and (values := values_in(variables[name], UNITS, tally)) is not None
                and (name in PLACES or np.isfinite(values).any())
            }
            if not set(PLACES) <= set(numbers):
                raise InputError(
                    f"{path.name}: {', '.join(sorted(set(PLACES) - set(numbers)))}: no places or "
                    "times by their units"
                )
            for name in ("time", "time_uv"):
                said = attributes_of(variables[name])
                numbers[name] = seconds_of(numbers[name], said, f"{path.name} {name}", tally)
            bins = values_in(variables["depth"], UNITS, tally)
            if bins is None:
                raise InputError(f"{path.name}: depth is no length by its unit")
            depth = np.abs(bins)
            count = len(numbers["time"])
            water = {
                name: _by_profile(variables[name], values, count, len(depth), path)
                for name in WATER
                if name in variables
                and (values := values_in(variables[name], UNITS, tally)) is not None
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
    found = SprayProfiles(
        numbers=numbers, depth=np.broadcast_to(depth, (count, len(depth))), water=water
    )
    note_unread(_KIND, names, READ, tally)
    leave_out(
        [n for n in ("u", "v") if n in names], "a mean over bins, no velocity of a time", tally
    )
    return _usable(found, path, tally)


def _rows(file: Any, path: Path, ours: Mapping[str, str], tally: Tally) -> SprayProfiles:
    """An OG1.0 file, whose rows are samples of the climb: a profile's have one number.

    Args:
      ours: names of the file, by the same in small letters.
    """
    variables = file.variables

    def column(name: str) -> Array:
        variable = variables[ours[IN_ROWS.get(name, name)]]
        values = as_array(variable[:])
        flags = variables.get(ours.get(f"{IN_ROWS.get(name, name)}_qc", ""))
        if flags is not None and flags.shape == variable.shape and flags.dtype != str:
            values = np.where(np.isin(as_array(flags[:]), _BAD), np.nan, values)
        if name in UNITS:
            said = unit_in(attributes_of(variable))
            other = declared(values, said, UNITS[name], ours[IN_ROWS[name]], tally)
            values = np.full(len(values), np.nan) if other is None else other
        if name in ("time", "time_uv"):
            values = seconds_of(values, attributes_of(variable), f"{path.name} {name}", tally)
        return values

    try:
        there = [name for name, own in IN_ROWS.items() if own in ours]
        rows = {name: column(name) for name in there}
        number = column(NUMBER)
        deployment = text_of(variables.get(ours.get("trajectory", "")))
    except (RuntimeError, OSError) as error:
        raise InputError(f"{path.name} is damaged: {' '.join(str(error).split())}") from error
    known = np.isfinite(number)
    _, first, of, count = np.unique(
        number[known], return_index=True, return_inverse=True, return_counts=True
    )
    place = np.zeros(known.sum(), np.intp)
    order = np.argsort(of, kind="stable")
    place[order] = np.arange(len(order)) - np.repeat(np.cumsum(count) - count, count)

    def padded(values: Array) -> Array:
        out = np.full((len(first), int(count.max(initial=0))), np.nan)
        out[of, place] = values[known]
        return out

    numbers = {n: rows[n][known][first] for n in there if n not in ("depth", *WATER)}
    note_unread(_KIND, list(variables), [ours[n] for n in ours if n in _OF_ROWS], tally)
    found = SprayProfiles(
        numbers={**numbers, "owner": np.zeros(len(first))},
        depth=np.abs(padded(rows["depth"])),
        water={name: padded(rows[name]) for name in WATER if name in rows},
        deployment=deployment or path.stem,
    )
    return _usable(found, path, tally)


_OF_ROWS = frozenset(
    {NUMBER, "trajectory", *IN_ROWS.values(), *(f"{name}_qc" for name in IN_ROWS.values())}
)


def _usable(found: SprayProfiles, path: Path, tally: Tally) -> SprayProfiles:
    """The profiles with a place and a time."""
    numbers = found.numbers
    half = 2.0 * (numbers["time"] - numbers["time_uv"])
    usable = np.isfinite(np.stack([numbers[name] for name in (*PLACES, "owner")])).all(axis=0)
    usable &= (half > 0.0) & (half < 0.5 * LONGEST)
    tally.add("left out", path.name, int((~usable).sum()), "profiles without place or time")
    if not usable.any():
        raise InputError(f"{path.name}: no profile has a place and a time (time, time_uv)")
    tally.add("read", path.name, int(usable.sum()), "profiles")
    tally.add(
        "note", path.name, int(usable.sum()),
        "fixes are made again of the middles of dive and profile, times of bins of an even climb",
    )  # fmt: skip
    return dataclasses.replace(
        found,
        numbers={name: values[usable] for name, values in numbers.items()},
        depth=found.depth[usable],
        water={name: values[usable] for name, values in found.water.items()},
    )


def _by_profile(variable: Any, values: Array, profiles: int, bins: int, path: Path) -> Array:
    values = values.reshape(variable.shape)
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
    times, depths, rows, bins = [], [], [], []
    for row, deep in enumerate(found.depth[order]):
        there = np.isfinite(np.stack([v[row] for v in sampled.values()])).any(axis=0)
        down = np.flatnonzero(there & np.isfinite(deep))
        down = down[np.argsort(deep[down])]
        if not len(down) or not deep[down[-1]] > 0.0:
            continue
        part = np.concatenate([[0.0], deep[down] / deep[down[-1]]])
        for side in (-1.0, 1.0):
            way = slice(None) if side < 0.0 else slice(-2, None, -1)
            times.append(middle[row] + side * half[row] * (1.0 - part[way]))
            depths.append(part[way] * deep[down[-1]])
            rows.append(np.full(len(part[way]), row if side > 0.0 else -1))
            bins.append(np.append(-1, down)[way])
    if not times:
        raise InputError(f"{file}: no profile of {name} has temperature or salinity")
    time, depth, of, bin_ = _rising(*(np.concatenate(each) for each in (times, depths, rows, bins)))
    channels = {"measured_depth": clean("measured_depth", time, depth, tally, subject=file)}
    up = (of >= 0) & (depth > 0.0)
    index = of[up].astype(int), bin_[up].astype(int)
    water = {key: values[index] for key, values in sampled.items()}
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
