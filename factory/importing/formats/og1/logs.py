"""Reader of OceanGliders OG1.0 netCDF files, those of `factory export` included.

The format's names are upper case; positions along the track are the glider's own, fixes are in
LATITUDE_GPS and LONGITUDE_GPS. Angles are degrees, actuators as their units say.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.terms import MEASURED
from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.reading.columns import tidy, unix_seconds
from factory.importing.reading.deployment_log import EMPTY, NO_FIXES, Channel, DeploymentLog, Fixes
from factory.importing.reading.netcdf import as_array, open_netcdf
from factory.importing.reading.tally import Tally
from factory.importing.reading.unread_names import note_unread
from factory.importing.repairs.angles import REACH, to_degrees
from factory.importing.repairs.cleaning import clean, from_degrees, positions, to_dbar
from factory.importing.repairs.seawater import ctd_channels, siemens
from twin.errors import InputError
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

DIMENSION = "N_MEASUREMENTS"
OURS = {name: stored for name, stored, _ in MEASURED} | {
    stored.upper(): stored for stored in VARIABLES if stored.startswith("true_")
}
"""Names that `factory export` writes, and the store's."""
ALIASES = {
    "measured_pitch": ("PITCH", "GLIDER_PITCH"),
    "measured_roll": ("ROLL", "GLIDER_ROLL"),
    "measured_heading": ("HEADING", "GLIDER_HEADING", "HEADING_TRUE"),
    "measured_pressure": ("PRES", "PRES_ADJUSTED", "NAV_PRESSURE"),
    "measured_depth": ("DEPTH", "DEPTH_Z", "GLIDER_DEPTH"),
    "measured_pump": ("PUMPED_VOLUME", "VBD_CC", "BUOYANCY_CC", "OIL_VOLUME", "BALLAST_CC"),
}
"""Names seen in OG1.0 files for channels of the store, in order of preference."""
TEMPERATURES, SALINITIES = ("TEMP", "TEMP_ADJUSTED"), ("PSAL", "PSAL_ADJUSTED")
CONDUCTIVITIES = ("CNDC",)
_READ = (
    *OURS, *(name for names in ALIASES.values() for name in names), *TEMPERATURES, *SALINITIES,
    *CONDUCTIVITIES, "LATITUDE", "LONGITUDE", "LATITUDE_GPS", "LONGITUDE_GPS", "TIME", "TIME_GPS",
)  # fmt: skip
_RADIAN = frozenset({"rad", "radian", "radians"})
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": 0.0254}


def read_og1(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """One log for each file: the format's unit is a deployment.

    Raises:
      WrongFormat: another kind of file.
      InputError: a file is damaged.
    """
    logs = [_file(path, options.variation_deg, tally) for path in paths]
    names = [log.deployment for log in logs]
    for name in sorted({n for n in names if names.count(n) > 1}):
        tally.add("note", name, names.count(name), "files of one deployment: rows of each kept")
    return logs


def _file(path: Path, variation_deg: float | None, tally: Tally) -> DeploymentLog:
    with open_netcdf(path) as file:
        variables = file.variables
        if "TIME" not in variables or DIMENSION not in file.dimensions:
            raise WrongFormat(path, [*variables, *file.groups])
        try:
            raw = {
                name: as_array(variable[:])
                for name, variable in variables.items()
                if variable.dimensions == (DIMENSION,) and variable.dtype != str
                and variable.dtype.kind in "fiu" and not name.endswith("_QC")
            }  # fmt: skip
            attributes = {name: _attributes(variables[name]) for name in raw}
        except (RuntimeError, OSError) as error:
            raise InputError(f"{path.name} is damaged: {' '.join(str(error).split())}") from error
        name = _deployment(file, path)
        platform = _text(variables.get("PLATFORM_MODEL")) or str(
            getattr(file, "platform", "underwater glider")
        )
        simulated = "simul" in str(getattr(file, "title", "")).lower()
    for key, values in raw.items():
        raw[key] = _without_fill(key, values, attributes[key], path, tally)
    time = raw.pop("TIME")
    if not np.isfinite(time).any():
        raise InputError(f"{path.name} holds no measurement with a time")
    time = _seconds(time, attributes["TIME"], path, tally)
    gps_time = raw.pop("TIME_GPS", np.full(len(time), np.nan))
    if np.isfinite(gps_time).any():
        gps_time = _seconds(gps_time, attributes["TIME_GPS"], path, tally)
    columns = {**raw, "TIME_GPS": gps_time}
    time, columns = tidy(time, columns, path.name, tally)
    tally.add("read", path.name, len(time), "measurements")
    note_unread("OG1 file", columns, _READ, tally)
    if simulated:
        tally.add("note", path.name, 1, "its title says that it is simulated, not observed")
    fixes = _fixes(columns, tally)
    variation = Channel(time[:1], np.array([variation_deg])) if variation_deg is not None else EMPTY
    channels = _channels(time, columns, attributes, variation, path, tally)
    channels |= _ctd(time, columns, channels, fixes, tally)
    return DeploymentLog(
        deployment=name,
        platform=platform,
        channels={key: channel for key, channel in channels.items() if len(channel)},
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary=_track(time, columns, tally),
        files=(path.name,),
        station="seaglider" in platform.lower(),
        simulated=simulated,
    )


def _attributes(variable: Any) -> dict[str, Any]:
    return {name: variable.getncattr(name) for name in variable.ncattrs()}


def _text(variable: Any) -> str:
    if variable is None:
        return ""
    value = variable[...]
    if getattr(value, "dtype", None) is not None and value.dtype.kind == "S":
        return b"".join(np.ma.filled(value, b"").ravel()).decode("utf-8", "replace").strip("\0 ")
    return str(value)


def _deployment(file: Any, path: Path) -> str:
    for source in ("TRAJECTORY", "trajectory"):
        text = _text(file.variables.get(source))
        if text and not re.fullmatch(r"[\d.\[\]]+", text):
            return text
    return str(getattr(file, "id", path.stem))


def _without_fill(
    name: str, values: Array, attributes: Mapping[str, Any], path: Path, tally: Tally
) -> Array:
    """Values outside the variable's own valid range as NaN, counted."""
    low, high = attributes.get("valid_min"), attributes.get("valid_max")
    bad = np.zeros(len(values), bool)
    with np.errstate(invalid="ignore"):
        if low is not None and name != "DEPTH":
            bad |= values < float(low)
        if high is not None:
            bad |= values > float(high)
    tally.add("removed", name, int(bad.sum()), "outside the file's valid range")
    return np.where(bad, np.nan, values)


def _seconds(time: Array, attributes: Mapping[str, Any], path: Path, tally: Tally) -> Array:
    """Unix seconds by the variable's units, or by size where it has none."""
    import netCDF4

    units = str(attributes.get("units", ""))
    if " since " not in units:
        return unix_seconds(time, path.name, tally)
    if units.startswith("seconds since 1970-01-01"):
        return time
    good = np.isfinite(time)
    try:
        moments: Any = netCDF4.num2date(
            [0.0, 1.0], units, calendar=str(attributes.get("calendar", "standard")),
            only_use_cftime_datetimes=False, only_use_python_datetimes=False,
        )  # fmt: skip
        zero = (moments[0] - type(moments[0])(1970, 1, 1)).total_seconds()
        unit = (moments[1] - moments[0]).total_seconds()
    except (ValueError, TypeError) as error:
        raise InputError(f"{path.name}: TIME has unknown units {units!r}") from error
    return np.where(good, zero + unit * time, np.nan)


def _fixes(columns: Mapping[str, Array], tally: Tally) -> Fixes:
    if not all(name in columns for name in ("LATITUDE_GPS", "LONGITUDE_GPS")):
        return NO_FIXES
    latitude, longitude = positions(
        columns["LATITUDE_GPS"], columns["LONGITUDE_GPS"], "GPS fixes", tally
    )
    time = columns["TIME_GPS"]
    good = np.isfinite(time) & np.isfinite(latitude) & np.isfinite(longitude)
    # a fix that is repeated at the following measurements is one fix
    unique, first = np.unique(time[good], return_index=True)
    return Fixes(unique, latitude[good][first], longitude[good][first])


def _channels(
    time: Array,
    columns: Mapping[str, Array],
    attributes: Mapping[str, Mapping[str, Any]],
    variation: Channel,
    path: Path,
    tally: Tally,
) -> dict[str, Channel]:
    sources = {target: name for name, target in OURS.items() if name in columns}
    for target, names in ALIASES.items():
        found = next((n for n in names if n in columns and np.isfinite(columns[n]).any()), None)
        if found is not None:
            sources[target] = found
    channels: dict[str, Channel] = {}
    depth = columns.get(sources.get("measured_depth", ""))
    flying = depth is not None and bool(np.nanmax(depth, initial=0.0) > _FLYING)
    for target, name in sources.items():
        values, units = columns[name], str(attributes[name].get("units", ""))
        if VARIABLES[target].units == "degree":
            if units.lower() in _RADIAN:
                part = target.split("_")[-1]
                kind = part if part in REACH else "roll"
                values = to_degrees(values, name, tally, kind=kind)
            elif target == "measured_pitch":
                values = from_degrees(values, name, tally, flying=flying)
        elif target == "measured_shift":
            values = values * _LENGTHS.get(units, 1.0)
        elif target == "measured_pressure":
            values = to_dbar(values, depth, name, tally, native="bar" if units == "bar" else "dbar")
        if target == "measured_heading":
            values = _true_heading(values, time, attributes[name], variation, path, tally)
        channels[target] = clean(target, time, values, tally, subject=name)
    if depth is not None and "measured_pressure" in channels:
        channels.pop("measured_depth", None)  # computed from pressure, as for every log
    return channels


_FLYING = 20.0


def _true_heading(
    values: Array,
    time: Array,
    attributes: Mapping[str, Any],
    variation: Channel,
    path: Path,
    tally: Tally,
) -> Array:
    """Heading from true north: a variable that calls itself magnetic needs the variation."""
    words = " ".join(str(attributes.get(k, "")) for k in ("long_name", "comment", "standard_name"))
    if "magnetic" in words.lower():
        if not len(variation):
            raise InputError(
                f"{path.name}: HEADING is magnetic by its description; give the variation with "
                "--variation-deg, east positive"
            )
        return np.mod(values + variation.at(time), 360.0)
    if len(variation):
        return np.mod(values + variation.at(time), 360.0)
    tally.add("note", "measured_heading", len(values), "taken as true: the file does not say else")
    return np.mod(values, 360.0)


def _ctd(
    time: Array,
    columns: Mapping[str, Array],
    channels: Mapping[str, Channel],
    fixes: Fixes,
    tally: Tally,
) -> dict[str, Channel]:
    def first(names: Sequence[str]) -> Array | None:
        return next((columns[n] for n in names if n in columns), None)

    temperature = first(TEMPERATURES)
    at = channels.get("measured_pressure") or channels.get("measured_depth") or EMPTY
    if temperature is None or not len(at):
        return {}
    practical, conductivity = first(SALINITIES), first(CONDUCTIVITIES)
    if conductivity is not None and practical is None:
        conductivity = siemens(conductivity, "CNDC", tally)
    latitude, longitude = columns.get("LATITUDE"), columns.get("LONGITUDE")
    place = (0.0, 0.0)
    if len(fixes):
        place = float(np.median(fixes.latitude)), float(np.median(fixes.longitude))
    elif latitude is not None and longitude is not None and np.isfinite(latitude).any():
        place = float(np.nanmedian(latitude)), float(np.nanmedian(longitude))
    return ctd_channels(
        time,
        temperature=temperature,
        pressure=at.at(time),
        practical=practical,
        conductivity=None if practical is not None else conductivity,
        latitude=place[0],
        longitude=place[1],
        tally=tally,
    )


def _track(time: Array, columns: Mapping[str, Array], tally: Tally) -> dict[str, Channel]:
    """The glider's own track."""
    if not all(name in columns for name in ("LATITUDE", "LONGITUDE")):
        return {}
    latitude, longitude = positions(
        columns["LATITUDE"], columns["LONGITUDE"], "LATITUDE, LONGITUDE", tally
    )
    good = np.isfinite(latitude) & np.isfinite(longitude)
    if not good.any():
        return {}
    return {
        "latitude": Channel(time[good], latitude[good]),
        "longitude": Channel(time[good], longitude[good]),
    }
