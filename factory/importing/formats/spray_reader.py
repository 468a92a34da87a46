"""Spray reader: binned profiles of several missions, in bins of depth.

A file has place and time of the middle of each dive (`lat_uv`, `lon_uv`, `time_uv`), and of the
middle of its profile, measured on the climb (`lat`, `lon`, `time`). By the files' own comments, the
profile's middle is at three quarters of the path between the fixes. So the fixes are twice the
difference of the middles before and after the dive's middle. Bins have no times: the glider is
assumed to sink and rise evenly, and to turn in the middle of the dive.

OG1.0 files of the Spray data center have one row for each sample of the climb. They repeat the
times of dive and profile in these rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import clean
from factory.importing.columns import with_values
from factory.importing.deployment_log import (
    EMPTY,
    Channel,
    DeploymentLog,
    LoggedFixes,
    each_file,
    joined,
)
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
from factory.importing.pressures import ctd_channels, pressure_of
from factory.importing.tally import Tally, leave_out, note_unread
from factory.importing.units import PRACTICAL, declared
from twin.errors import InputError

Array = NDArray[np.float64]

PLACES = ("time", "lat", "lon", "time_uv", "lat_uv", "lon_uv")
"""Time and position of the middle of a profile and of its dive, (profile,) each."""
CURRENTS = {"dac_east": "u_depth_mean", "dac_north": "v_depth_mean"}
"""[m/s] Current averaged over the depths of a dive, (profile,)."""
WATER = ("temperature", "salinity")
"""Variables of the water, (depth, profile) or (profile, depth)."""
UNITS = {
    "depth": "m", "temperature": "degree_Celsius", "salinity": PRACTICAL,
    **dict.fromkeys(("lat", "lon", "lat_uv", "lon_uv"), "degree"),
    **dict.fromkeys(CURRENTS.values(), "m s-1"),
}  # fmt: skip
"""Units that variables are converted to, from the declared ones."""
OWNERS = ("mission", "trajectory_index")
"""Variables with the number of a profile's mission; the first in the file is used."""
READ = ("depth", *PLACES, *CURRENTS.values(), *WATER, *OWNERS, "trajectory", "profile")
ROW = "n_measurements"
"""Dimension of OG1.0, in small letters: its names are compared in small letters here."""
NUMBER = "profile_index"
"""Variable with the profile's number in each row of OG1.0."""
IN_ROWS = {
    "time": "time_profile", "lat": "latitude_profile", "lon": "longitude_profile",
    "time_uv": "time_uv", "lat_uv": "latitude_uv", "lon_uv": "longitude_uv",
    "u_depth_mean": "wcur_x", "v_depth_mean": "wcur_y",
    "depth": "depth", "temperature": "temp", "salinity": "psal",
}  # fmt: skip
"""Names of OG1.0, in small letters, by the names of binned files."""
_BAD = (3.0, 4.0, 9.0)
"""Quality flags: probably bad, bad, missing."""
LONGEST = 86400.0
"""[s] Longest dive of a glider."""
_KIND = "Spray's binned file"


class SprayProfiles(NamedTuple):
    """Profiles of one file."""

    numbers: dict[str, Array]
    """Numbers by name, (profile,) each."""
    depth: Array
    """[m] Depth of the bins, down, (profile, bin); NaN behind the last bin."""
    water: dict[str, Array]
    """Temperature and salinity, (profile, bin) each."""
    deployment: str | None = None
    """Name of the deployment, if the file holds only one."""

    def keep(self, index: NDArray[np.bool_] | NDArray[np.intp]) -> SprayProfiles:
        """Profiles where a mask is true, or at these indices."""
        numbers, water = (
            {n: v[index] for n, v in one.items()} for one in (self.numbers, self.water)
        )
        return SprayProfiles(numbers, self.depth[index], water, self.deployment)


def read_spray(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Make one log for each mission in each file.

    Raises:
      WrongFormat: a file is of another kind.
      InputError: a file is damaged, or none of its profiles has a position and a time.
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

        def known(*wanted: str) -> dict[str, Array]:
            return {
                name: values
                for name in wanted
                if name in variables
                and (values := values_in(variables[name], UNITS, tally)) is not None
            }

        numbers = known(*PLACES, *CURRENTS.values(), *OWNERS)
        numbers = with_values(numbers, PLACES)
        lacking = sorted(set(PLACES) - set(numbers))
        if lacking:
            raise InputError(
                f"{path.name}: {', '.join(lacking)}: no places or times by their units"
            )
        for name in ("time", "time_uv"):
            attributes = attributes_of(variables[name])
            numbers[name] = seconds_of(numbers[name], attributes, f"{path.name} {name}", tally)
        bins = known("depth")
        if not bins:
            raise InputError(f"{path.name}: depth is no length by its unit")
        depth = np.abs(bins["depth"])
        count = len(numbers["time"])
        water = {
            name: _by_profile(variables[name], values, count, len(depth), path)
            for name, values in known(*WATER).items()
        }
    odd = [name for name, values in numbers.items() if len(values) != count]
    if odd:
        raise InputError(
            f"{path.name}: {odd[0]} has {len(numbers[odd[0]])} values, time {count}: one belongs "
            "to each profile"
        )
    owner = next((name for name in OWNERS if name in numbers), None)
    numbers["owner"] = np.zeros(count) if owner is None else numbers[owner]
    note_unread(_KIND, names, READ, tally)
    why = "a mean over bins, no velocity of a time"
    leave_out([n for n in ("u", "v") if n in names], why, tally)
    depths = np.broadcast_to(depth, (count, len(depth)))
    return _usable(SprayProfiles(numbers, depths, water), path, tally)


def _rows(file: Any, path: Path, ours: Mapping[str, str], tally: Tally) -> SprayProfiles:
    """Read an OG1.0 file, whose rows are samples of the climb with the number of their profile.

    Args:
      ours: names of the file, by their small letters.
    """
    variables = file.variables

    def column(name: str) -> Array:
        own = IN_ROWS.get(name, name)
        variable = variables[ours[own]]
        values, described = as_array(variable[:]), attributes_of(variable)
        flags = variables.get(ours.get(f"{own}_qc", ""))
        if flags is not None and flags.shape == variable.shape and flags.dtype != str:
            values = np.where(np.isin(as_array(flags[:]), _BAD), np.nan, values)
        if name in UNITS:
            other = declared(values, unit_in(described), UNITS[name], ours[own], tally)
            values = np.full(len(values), np.nan) if other is None else other
        if name in ("time", "time_uv"):
            values = seconds_of(values, described, f"{path.name} {name}", tally)
        return values

    there = [name for name, own in IN_ROWS.items() if own in ours]
    rows = {name: column(name) for name in there}
    number = column(NUMBER)
    deployment = text_of(variables.get(ours.get("trajectory", "")))
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
        {**numbers, "owner": np.zeros(len(first))}, np.abs(padded(rows["depth"])),
        {name: padded(rows[name]) for name in WATER if name in rows}, deployment or path.stem,
    )  # fmt: skip
    return _usable(found, path, tally)


_OF_ROWS = frozenset(
    {NUMBER, "trajectory", *IN_ROWS.values(), *(f"{name}_qc" for name in IN_ROWS.values())}
)


def _usable(found: SprayProfiles, path: Path, tally: Tally) -> SprayProfiles:
    """Profiles with a position and a time."""
    numbers = found.numbers
    half = 2.0 * (numbers["time"] - numbers["time_uv"])
    usable = np.isfinite(np.stack([numbers[name] for name in (*PLACES, "owner")])).all(axis=0)
    usable &= (half > 0.0) & (half < 0.5 * LONGEST)
    tally.add("left out", path.name, ~usable, "profiles without place or time")
    if not usable.any():
        raise InputError(f"{path.name}: no profile has a place and a time (time, time_uv)")
    tally.add("read", path.name, usable, "profiles")
    why = "fixes are made again of the middles of dive and profile, times of bins of an even climb"
    tally.add("note", path.name, usable, why)
    return found.keep(usable)


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
    found = found.keep(np.flatnonzero(mine)[np.argsort(found.numbers["time_uv"][mine])])
    numbers = found.numbers
    middle = numbers["time_uv"]
    half = 2.0 * (numbers["time"] - middle)
    sides = np.array([-2.0, 2.0])
    latitude, longitude = (
        (numbers[f"{axis}_uv"][:, None] + sides * (numbers[axis] - numbers[f"{axis}_uv"])[:, None])
        for axis in ("lat", "lon")
    )
    ends = middle[:, None] + 0.5 * sides * half[:, None]
    fixes = LoggedFixes(ends.ravel(), latitude.ravel(), longitude.ravel()).once()
    valued = [np.isfinite(values) for values in found.water.values()]
    samples = []
    for row, deep in enumerate(found.depth):
        there = np.any([one[row] for one in valued], axis=0)
        down = np.flatnonzero(there & np.isfinite(deep))
        down = down[np.argsort(deep[down])]
        if not len(down) or not deep[down[-1]] > 0.0:
            continue
        part = np.concatenate([[0.0], deep[down] / deep[down[-1]]])
        for side in (-1.0, 1.0):
            way = slice(None) if side < 0.0 else slice(-2, None, -1)
            time = middle[row] + side * half[row] * (1.0 - part[way])
            of = np.full(len(time), row if side > 0.0 else -1)
            samples.append((time, part[way] * deep[down[-1]], of, np.append(-1, down)[way]))
    if not samples:
        raise InputError(f"{file}: no profile of {name} has temperature or salinity")
    time, depth, of, bin_ = _sorted(*(np.concatenate(each) for each in zip(*samples, strict=True)))
    channels = {"measured_depth": clean("measured_depth", time, depth, tally, subject=file)}
    up = (of >= 0) & (depth > 0.0)
    water = {key: v[of[up].astype(int), bin_[up].astype(int)] for key, v in found.water.items()}
    if "temperature" in water:
        north, east = fixes.at(time[up])
        channels |= ctd_channels(
            time[up], temperature=water["temperature"], pressure=pressure_of(depth[up], north),
            practical=water.get("salinity"), latitude=north, longitude=east, tally=tally,
        )  # fmt: skip
    reported = {
        target: joined([Channel.finite(middle + half, numbers[own])])
        for target, own in CURRENTS.items() if own in numbers
    }  # fmt: skip
    return DeploymentLog(
        deployment=name,
        platform="Spray",
        channels=channels,
        fixes=fixes,
        magnetic_variation=EMPTY,
        auxiliary={target: one for target, one in reported.items() if len(one)},
        files=(file,),
        station=True,
    )


def _sorted(time: Array, *columns: Array) -> tuple[Array, ...]:
    """Sort columns by time; keep each time once."""
    time, first = np.unique(time, return_index=True)
    return (time, *(column[first] for column in columns))
