"""Reader of OceanGliders OG1.0 netCDF files, those of `factory export` included.

The format's names are upper case; positions along the track are the glider's own, fixes are in
LATITUDE_GPS and LONGITUDE_GPS. Angles are degrees, actuators as their units say.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.terms import MEASURED
from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.reading.columns import tidy
from factory.importing.reading.deployment_log import EMPTY, NO_FIXES, Channel, DeploymentLog, Fixes
from factory.importing.reading.each_file import each_file
from factory.importing.reading.netcdf import (
    as_array,
    attributes_of,
    open_netcdf,
    seconds_of,
    text_of,
)
from factory.importing.reading.payload import payload_channels, payload_names
from factory.importing.reading.tally import Tally
from factory.importing.reading.unread_names import leave_out, note_empty, note_unread
from factory.importing.repairs.angles import REACH, to_degrees
from factory.importing.repairs.cleaning import clean, from_degrees, positions, to_dbar
from factory.importing.repairs.declination import reference_declination
from factory.importing.repairs.seawater import ctd_channels, siemens
from twin.errors import InputError
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

DIMENSION = "N_MEASUREMENTS"
OURS = {name: stored for name, stored, _ in MEASURED} | {
    stored.upper(): stored
    for stored in VARIABLES
    if stored.startswith(("true_", "commanded_", "measured_current_"))
    and not stored.startswith("commanded_waypoint")
}
"""Names that `factory export` writes, and the store's."""
ALIASES = {
    "measured_pitch": ("PITCH", "GLIDER_PITCH"),
    "measured_roll": ("ROLL", "GLIDER_ROLL"),
    "measured_heading": ("HEADING", "GLIDER_HEADING", "HEADING_TRUE"),
    "measured_pressure": ("PRES", "PRES_ADJUSTED", "NAV_PRESSURE"),
    "measured_depth": ("DEPTH", "DEPTH_Z", "GLIDER_DEPTH"),
    "measured_pump": (
        "PUMPED_VOLUME",
        "VBD_CC",
        "BUOYANCY_CC",
        "OIL_VOLUME",
        "BALLAST_CC",
        "eng_vbdCC",
    ),
}
"""Names seen in OG1.0 files for channels of the store, in order of preference."""
TEMPERATURES = ("TEMP", "TEMP_ADJUSTED", "TEMP_RAW")
SALINITIES = ("PSAL", "PSAL_ADJUSTED", "PSAL_RAW")
CONDUCTIVITIES = ("CNDC", "CNDC_RAW")
DIVES = ("dive_num", "divenum", "DIVE_NUMBER")
"""Numbers of the dives, as converters from Seaglider files keep them."""
CORRECTED = "POSITION_SD"
"""Files of `factory export` have it beside a track that is corrected at the fixes."""
CURRENTS = {"dac_north": "DAVG_CURR_NORTH", "dac_east": "DAVG_CURR_EAST"}
"""[m/s] Reported depth-averaged current, at the measurements of its dive."""
_NAMES = ("TRAJECTORY", "trajectory", "PLATFORM_MODEL")
_READ = (
    *OURS, *(name for names in ALIASES.values() for name in names), *TEMPERATURES, *SALINITIES,
    *CONDUCTIVITIES, "LATITUDE", "LONGITUDE", "LATITUDE_GPS", "LONGITUDE_GPS", "TIME", "TIME_GPS",
    "LATITUDE_ONBOARD", "LONGITUDE_ONBOARD",
    *DIVES, *CURRENTS.values(), *_NAMES,
)  # fmt: skip
_RADIAN = frozenset({"rad", "radian", "radians"})
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": 0.0254}


def read_og1(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """One log for each file: the format's unit is a deployment.

    Raises:
      WrongFormat: another kind of file.
      InputError: a file is damaged.
    """
    logs = [log for _, log in each_file(paths, lambda path: _file(path, options, tally), tally)]
    names = [log.deployment for log in logs]
    for name in sorted({n for n in names if names.count(n) > 1}):
        tally.add("note", name, names.count(name), "files of one deployment: rows of each kept")
    return logs


def _file(path: Path, options: ReadOptions, tally: Tally) -> DeploymentLog:
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
            attributes = {name: attributes_of(variables[name]) for name in raw}
            names = list(variables)
        except (RuntimeError, OSError) as error:
            raise InputError(f"{path.name} is damaged: {' '.join(str(error).split())}") from error
        name = _deployment(file, path)
        platform = text_of(variables.get("PLATFORM_MODEL")) or str(
            getattr(file, "platform", "underwater glider")
        )
        simulated = "simul" in str(getattr(file, "title", "")).lower()
    for key, values in raw.items():
        raw[key] = _without_fill(key, values, attributes[key], path, tally)
    time = raw.pop("TIME")
    if not np.isfinite(time).any():
        raise InputError(f"{path.name} holds no measurement with a time")
    time = seconds_of(time, attributes["TIME"], path.name, tally)
    if np.isfinite(raw.get("TIME_GPS", np.zeros(0))).any():
        gps_time = seconds_of(raw["TIME_GPS"], attributes["TIME_GPS"], path.name, tally)
    else:  # the fixes are at the measurements
        gps_time = time
    columns = {**raw, "TIME_GPS": gps_time}
    time, columns = tidy(time, columns, path.name, tally)
    tally.add("read", path.name, len(time), "measurements")
    extra = payload_names(options.payload)
    note_unread("OG1 file", names, (*_READ, *extra), tally)
    empty = [n for n, values in raw.items() if not np.isfinite(values).any()]
    note_empty("OG1 file", empty, tally)
    if simulated:
        tally.add("note", path.name, 1, "its title says that it is simulated, not observed")
    fixes = _fixes(columns, tally)
    track = _track(time, columns, tally)
    variation = Variation(options.variation_deg, _places(fixes, track), name)
    channels, used, applied = _channels(time, columns, attributes, variation, path, tally)
    water, from_ctd = _ctd(time, columns, channels, fixes, tally)
    channels |= water
    found = {
        n: Channel(time[there], columns[n][there])
        for n in extra
        if n in columns and (there := np.isfinite(columns[n])).any()
    }
    units = {n: str(attributes[n].get("units", "")) for n in found}
    channels |= payload_channels(found, options.payload, tally, units=units)
    known = {n for names in ALIASES.values() for n in names} | {*TEMPERATURES, *SALINITIES}
    known |= {*CONDUCTIVITIES, *OURS}
    unused = [n for n in raw if n in known - used - from_ctd and n not in empty]
    leave_out(unused, "another variable of the file gives it", tally)
    track |= _dives(time, columns, fixes, tally)
    return DeploymentLog(
        deployment=name,
        platform=platform,
        channels={key: channel for key, channel in channels.items() if len(channel)},
        fixes=fixes,
        magnetic_variation=applied,
        auxiliary=track,
        files=(path.name,),
        station="seaglider" in platform.lower() or bool(_SEAGLIDER.match(name)),
        simulated=simulated,
    )


def _deployment(file: Any, path: Path) -> str:
    for source in ("TRAJECTORY", "trajectory"):
        text = text_of(file.variables.get(source))
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


_SEAGLIDER = re.compile(r"sg\d{3}(_|$)", re.IGNORECASE)
"""Names of a Seaglider's deployments."""


@dataclasses.dataclass(frozen=True)
class Variation:
    """Where the magnetic variation comes from."""

    given: float | None
    """[degree] By the user."""
    places: Fixes
    """Where the vehicle was: its fixes, else its own track."""
    deployment: str

    def at(self, time: Array, tally: Tally) -> Array | None:
        """[degree] east positive, by the user or by the reference field; None without a place."""
        if self.given is not None:
            return np.full(len(time), self.given)
        found = reference_declination(self.places, self.deployment, tally)
        return found.at(time) if len(found) else None


def _places(fixes: Fixes, track: Mapping[str, Channel]) -> Fixes:
    if len(fixes) or "latitude" not in track:
        return fixes
    latitude = track["latitude"]
    return Fixes(latitude.time, latitude.values, track["longitude"].at(latitude.time))


def _dives(
    time: Array, columns: Mapping[str, Array], fixes: Fixes, tally: Tally
) -> dict[str, Channel]:
    """Numbers of the dives, and the reported current at the fix that ends each."""
    found: dict[str, Channel] = {}
    numbers = next((columns[n] for n in DIVES if n in columns), None)
    if numbers is None:
        leave_out([n for n in CURRENTS.values() if n in columns], "no dive numbers", tally)
        return found
    there = np.isfinite(numbers)
    found["dive"] = Channel(time[there], numbers[there])
    for target, name in CURRENTS.items():
        if name not in columns:
            continue
        values = np.where(there, columns[name], np.nan)
        good = np.flatnonzero(np.isfinite(values))
        last = good[np.append(numbers[good][1:] != numbers[good][:-1], True)] if good.size else good
        at = time[last]
        if len(fixes):
            following = np.searchsorted(fixes.time, at)
            inside = following < len(fixes)
            at = np.where(inside, fixes.time[np.minimum(following, len(fixes) - 1)], at)
        unique, first = np.unique(at, return_index=True)
        found[target] = Channel(unique, values[last][first])
    return found


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
    variation: Variation,
    path: Path,
    tally: Tally,
) -> tuple[dict[str, Channel], set[str], Channel]:
    """Channels, the names that they come from, and the variation that was added."""
    applied = EMPTY
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
            values, applied = _true_heading(values, time, attributes[name], variation, path, tally)
        channels[target] = clean(target, time, values, tally, subject=name)
    if depth is not None and "measured_pressure" in channels:
        channels.pop("measured_depth", None)  # computed from pressure, as for every log
    return channels, set(sources.values()), applied


_FLYING = 20.0


def _true_heading(
    values: Array,
    time: Array,
    attributes: Mapping[str, Any],
    variation: Variation,
    path: Path,
    tally: Tally,
) -> tuple[Array, Channel]:
    """Heading from true north, and the variation that was added.

    A variable that calls itself magnetic needs one; others are true unless the user gives one.
    """
    words = " ".join(str(attributes.get(k, "")) for k in ("long_name", "comment", "standard_name"))
    if "magnetic" in words.lower():
        known = variation.at(time, tally)
        if known is None:
            raise InputError(
                f"{path.name}: HEADING is magnetic by its description, and no position is there "
                "from which the variation follows; give it with --variation-deg, east positive"
            )
        return np.mod(values + known, 360.0), Channel(time, known)
    if variation.given is not None:
        known = np.full(len(time), variation.given)
        return np.mod(values + known, 360.0), Channel(time, known)
    tally.add("note", "measured_heading", len(values), "taken as true: the file does not say else")
    return np.mod(values, 360.0), EMPTY


def _ctd(
    time: Array,
    columns: Mapping[str, Array],
    channels: Mapping[str, Channel],
    fixes: Fixes,
    tally: Tally,
) -> tuple[dict[str, Channel], set[str]]:
    """Temperature, salinity and density, and the names that they come from."""

    def first(names: Sequence[str]) -> Array | None:
        found = next((n for n in names if n in columns and np.isfinite(columns[n]).any()), None)
        used.update([found] if found else [])
        return columns[found] if found else None

    used: set[str] = set()
    at = channels.get("measured_pressure") or channels.get("measured_depth") or EMPTY
    temperature = first(TEMPERATURES) if len(at) else None
    if temperature is None:
        return {}, used
    practical = first(SALINITIES)
    conductivity = first(CONDUCTIVITIES) if practical is None else None
    if conductivity is not None:
        conductivity = siemens(conductivity, "CNDC", tally)
    latitude, longitude = columns.get("LATITUDE"), columns.get("LONGITUDE")
    place = (0.0, 0.0)
    if len(fixes):
        place = float(np.median(fixes.latitude)), float(np.median(fixes.longitude))
    elif latitude is not None and longitude is not None and np.isfinite(latitude).any():
        place = float(np.nanmedian(latitude)), float(np.nanmedian(longitude))
    water = ctd_channels(
        time,
        temperature=temperature,
        pressure=at.at(time),
        practical=practical,
        conductivity=conductivity,
        latitude=place[0],
        longitude=place[1],
        tally=tally,
    )
    return water, used


def _track(time: Array, columns: Mapping[str, Array], tally: Tally) -> dict[str, Channel]:
    """The glider's own track: beside a corrected one where the file has both."""
    names = ("LATITUDE_ONBOARD", "LONGITUDE_ONBOARD")
    if not all(name in columns for name in names):
        if CORRECTED in columns:
            leave_out(["LATITUDE", "LONGITUDE"], "a track corrected at the fixes", tally)
            return {}
        names = ("LATITUDE", "LONGITUDE")
    if not all(name in columns for name in names):
        return {}
    first, second = (columns[name] for name in names)
    latitude, longitude = positions(first, second, ", ".join(names), tally)
    good = np.isfinite(latitude) & np.isfinite(longitude)
    if not good.any():
        return {}
    return {
        "latitude": Channel(time[good], latitude[good]),
        "longitude": Channel(time[good], longitude[good]),
    }
