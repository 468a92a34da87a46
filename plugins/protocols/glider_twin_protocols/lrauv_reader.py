"""LRAUV reader: MATLAB v7.3 (.mat), netCDF-4 (.nc4) and the simulator's csv files.

Every variable has its own time: in a .mat file a group of time (days since year 0), value and
units, in a .nc4 file a coordinate NAME_time. Names are CF standard names; a value in a csv file is
followed by its unit. Signs of rudder and elevator are the vehicle's, which `tethys` shares: a
positive elevator pitches the nose down. The on-board track may be reset to GPS already at a
surfacing.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing import (
    EMPTY,
    NO_FIXES,
    PRACTICAL,
    Channel,
    DeploymentLog,
    LoggedFixes,
    ReadOptions,
    Tally,
    WrongFormat,
    clean,
    ctd_channels,
    declared,
    each_file,
    expect_going,
    note_empty,
    note_unread,
    parse_stamps,
    payload_channels,
    payload_names,
    positions,
    read_table,
    tidy,
    unit_of,
    unix_seconds,
    used_of_left,
    with_dbar_by_depth,
)
from factory.importing.netcdf import as_array, attributes_of, open_netcdf, unit_in
from twin import load_vehicle
from twin.errors import InputError
from twin.physics import declare_parts

Array = NDArray[np.float64]

MODEL = "tethys"
"""Vehicle file for all LRAUVs; channels of actuators have the names of its parts."""
SOURCES = {
    "depth": "measured_depth",
    "sea_water_pressure": "measured_pressure",
    "platform_pitch_angle": "measured_pitch",
    "platform_roll_angle": "measured_roll",
    "platform_orientation": "measured_heading",
    "platform_buoyancy_position": "measured_pump",
    "platform_mass_position": "measured_shift",
    "platform_rudder_angle": "measured_rudder",
    "platform_elevator_angle": "measured_elevator",
    "platform_propeller_rotation_rate": "measured_propeller",
    "platform_propeller_rotation_rate_1": "measured_propeller",
    "platform_battery_charge": "measured_charge",
    "platform_battery_voltage": "measured_voltage",
    "VerticalControl.buoyancyAction": "commanded_pump",
    "VerticalControl.massPositionAction": "commanded_shift",
    "VerticalControl.elevatorAngleAction": "commanded_elevator",
    "HorizontalControl.rudderAngleAction": "commanded_rudder",
    "SpeedControl.propOmegaAction": "commanded_propeller",
}
"""Channel of the store by source variable; of two sources the first with values is taken."""
_READ = (
    *SOURCES, "latitude", "longitude", "latitude_fix", "longitude_fix", "sea_water_temperature",
    "sea_water_salinity", "EpochSeconds", "Timestamp", "time", "time_fix",
)  # fmt: skip
_WITH_UNIT = re.compile(r"^\s*([-+0-9.eE]+|nan)\s*([^\d\s].*)?$", re.IGNORECASE)
_TURNING = 1.0
"""[rad/s] Rotation rate above which the propeller drives the vehicle."""

_SIMULATOR = (".csv", ".gz")

TimedValues = tuple[Array, Array, str]
"""Time as in the file, values, unit as in the file."""


def read_lrauv(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Read one log from each file.

    Raises:
      WrongFormat: a file is of another format.
      InputError: a file is truncated, or a unit is unknown.
    """
    every = each_file(paths, _series, tally)
    return [_log(path, *found, options, tally) for path, found in every]


def _series(path: Path) -> tuple[dict[str, TimedValues], list[str]]:
    """Variables of a file that have a time, and the names of all others: clocks, texts, tables."""
    if path.suffix.lower() in _SIMULATOR:
        return _csv(path), ["EpochSeconds", "Timestamp"]
    with open_netcdf(path) as file:
        found = _variables(file) | (_groups(file) if file.groups else {})
        names = [*file.groups, *file.variables]
        others = [*file.variables, *(n for n, g in file.groups.items() if not g.groups)]
    if "depth" not in found and "sea_water_pressure" not in found:
        raise WrongFormat(path, names)
    for name in ("depth", "sea_water_pressure"):
        if name in found:
            written, values, _ = found[name]
            time = unix_seconds(written, f"{path.name} {name}", Tally())
            expect_going(f"time of {name}", time, {name: values}, path.name)
    return found, [name for name in others if name not in found]


def _groups(file: Any) -> dict[str, TimedValues]:
    """Variables of a MATLAB file: groups of time, value and units; components nest such groups."""
    found: dict[str, TimedValues] = {}
    for name, group in file.groups.items():
        if name.startswith("#"):
            continue
        if {"time", "value"} <= set(group.variables):
            unit = group.variables.get("units")
            codes = () if unit is None else as_array(unit[:])
            text = "".join(chr(int(c)) for c in codes if 0.0 <= c <= sys.maxunicode)
            time, values = (as_array(group.variables[n][:]) for n in ("time", "value"))
            if len(time) == len(values):
                found[name] = (time, values, text.strip("\0 "))
        else:
            for inner, series in {**_groups(group), **_variables(group)}.items():
                found.setdefault(inner, series)
    return found


def _variables(file: Any) -> dict[str, TimedValues]:
    """Variables of a netCDF-4 file, each with its time NAME_time or its dimension's coordinate."""
    found: dict[str, TimedValues] = {}
    for name, variable in file.variables.items():
        if len(variable.dimensions) != 1 or variable.dtype == str:
            continue
        clocks = (f"{name}_time", variable.dimensions[0], "time")
        clock = next((file.variables[n] for n in clocks if n in file.variables), variable)
        if clock is variable or variable.dtype.kind not in "fiu":
            continue
        time, values = as_array(clock[:]), as_array(variable[:])
        if len(time) == len(values):
            found[name] = (time, values, unit_in(attributes_of(variable)))
    return found


def _csv(path: Path) -> dict[str, TimedValues]:
    """Variables of the simulator's csv file, whose values are numbers followed by their unit."""
    table = read_table(path)
    names = [*table.columns, *table.texts]
    if "depth" not in names or not {"EpochSeconds", "Timestamp"} & set(names):
        raise WrongFormat(path, names)
    time = table.columns.get("EpochSeconds")
    if time is None:
        time = parse_stamps(table.texts["Timestamp"])
    found: dict[str, TimedValues] = {n: (time, v, "") for n, v in table.columns.items()}
    for name in [name for name in table.texts if name != "Timestamp"]:
        values, units = np.full(len(time), np.nan), set()
        for i, word in enumerate(table.texts[name]):
            match = _WITH_UNIT.match(str(word))
            if match and match.group(1).lower() != "nan":
                values[i] = float(match.group(1))
                units.add((match.group(2) or "").strip())
        if len(units) > 1:
            raise InputError(f"{path.name}: column {name} mixes the units {', '.join(units)}")
        found[name] = (time, values, units.pop() if units else "")
    return found


def _log(
    path: Path,
    series: Mapping[str, TimedValues],
    others: Sequence[str],
    options: ReadOptions,
    tally: Tally,
) -> DeploymentLog:
    deployment = path.name.split(".")[0]
    extra = payload_names(options.payload)

    def raw(source: str, wanted: str = "", name: str = "") -> Channel:
        """Channel of a variable in unit `wanted`, if given; empty if it is of another quantity."""
        written, values, unit = series[source]
        if wanted:
            own = declared(values, unit, wanted, source, tally, deployment=deployment)
            if own is None:
                return EMPTY
            values = own
        time = unix_seconds(written, f"{path.name} {source}", Tally())
        time, columns = tidy(time, {name or source: values}, source, tally)
        return Channel.finite(time, *columns.values())

    def channel(name: str, source: str, wanted: str) -> Channel:
        one = raw(source, wanted, name)
        return clean(name, one.time, one.values, tally, subject=source)

    wanted = (*_READ, *extra)
    clocks = [f"{name}_time" for name in series if name in wanted]
    note_unread("LRAUV log", [*series, *others], [*wanted, *clocks], tally)
    empty = [n for n, (_, values, _) in series.items() if not np.isfinite(values).any()]
    note_empty("LRAUV log", [*empty, *(f"{name}_time" for name in empty)], tally)
    declare_parts(load_vehicle(MODEL))
    channels: dict[str, Channel] = {}
    for source, target in SOURCES.items():
        if source in series and source not in empty and target not in channels:
            channels[target] = channel(target, source, unit_of(target))
    if "measured_charge" in channels:
        channels["measured_charge"] = used_of_left(channels["measured_charge"])
    if not any(len(channels.get(f"measured_{name}", ())) for name in ("depth", "pressure")):
        raise InputError(f"{path.name} holds no depth")
    tally.add("read", path.name, max(len(c) for c in channels.values()), "samples")
    channels = with_dbar_by_depth(channels, tally, deployment)
    if "measured_heading" in channels and options.variation_deg is not None:
        one = channels["measured_heading"]
        turned = np.mod(one.values + options.variation_deg, 360.0)
        channels["measured_heading"] = Channel(one.time, turned)
    fixes = NO_FIXES
    if {"latitude_fix", "longitude_fix"} <= set(series):
        latitude, longitude = (raw(name, "degree") for name in ("latitude_fix", "longitude_fix"))
        fixes = _fixes(latitude, longitude, tally)
    depth = channels.get("measured_depth") or channels["measured_pressure"]
    if "sea_water_temperature" in series:
        warm = channel("measured_temperature", "sea_water_temperature", "degree_Celsius")
        practical = None
        if "sea_water_salinity" in series:
            fresh = channel("measured_salinity", "sea_water_salinity", PRACTICAL)
            practical = fresh.known(warm.time)
        north, east = fixes.at(warm.time)
        channels |= ctd_channels(
            warm.time, temperature=warm.values, pressure=depth.known(warm.time),
            practical=practical, latitude=north, longitude=east, tally=tally,
        )  # fmt: skip
    found = {name: raw(name) for name in extra if name in series}
    units = {name: series[name][2] for name in found}
    channels |= payload_channels(found, options.payload, tally, units=units)
    auxiliary: dict[str, Channel] = {}
    if "latitude" in series and "longitude" in series:
        track = {axis: channel(axis, axis, "degree") for axis in ("latitude", "longitude")}
        auxiliary |= track if all(len(one) > 1 for one in track.values()) else {}
    spin = channels.get("measured_propeller", EMPTY)
    if len(spin):
        auxiliary["thruster"] = Channel(spin.time, (np.abs(spin.values) > _TURNING).astype(float))
    return DeploymentLog(
        deployment=deployment,
        platform="LRAUV",
        channels=channels,
        fixes=fixes,
        magnetic_variation=EMPTY,
        auxiliary=auxiliary,
        files=(path.name,),
        model=MODEL,
        # the vehicle writes no csv: such files come from its software in simulation
        simulated=path.suffix.lower() in _SIMULATOR,
    )


def _fixes(latitude: Channel, longitude: Channel, tally: Tally) -> LoggedFixes:
    """Pair latitudes and longitudes, which are logged milliseconds apart, to GPS fixes."""
    time, other = latitude.time, longitude.time
    if not len(time) or not len(other):
        return NO_FIXES
    right = np.clip(np.searchsorted(other, time), 0, len(other) - 1)
    left = np.maximum(right - 1, 0)
    near = np.where(np.abs(other[left] - time) < np.abs(other[right] - time), left, right)
    pair = np.abs(other[near] - time) < _TOGETHER
    tally.add("removed", "GPS fixes", ~pair, "latitude without longitude")
    north, east = latitude.values[pair], longitude.values[near][pair]
    return LoggedFixes.finite(time[pair], *positions(north, east, "GPS fixes", tally))


_TOGETHER = 2.0
"""[s] Longest time between latitude and longitude of one fix."""
