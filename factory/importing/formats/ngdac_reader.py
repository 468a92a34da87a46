"""Reader of IOOS NGDAC netCDF files: one profile per file, which together make a deployment; and
of pyglider's time series, a deployment a file.

CF's names and units. Positions are the data assembly's track, interpolated between surfacings; GPS
fixes are known only where a file keeps the vehicle's own `m_gps_lat`, `m_gps_lon` (decimal degrees
or ddmm.mmm). The current of a segment, `u` and `v` at `time_uv`, stands in each of its profiles.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import LoggedAngle, attitude_degrees, reference_declination
from factory.importing.batteries import SLOCUM_SENSORS, SLOCUM_UNITS, slocum_batteries
from factory.importing.cleaning import clean, positions
from factory.importing.columns import stacked, tidy, with_values
from factory.importing.deployment_log import (
    EMPTY,
    NO_FIXES,
    Channel,
    DeploymentLog,
    LoggedFixes,
    each_file,
)
from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.formats.ngdac_pyglider import (
    ACTUATORS,
    MAGNETIC,
    SERIES,
    SLOCUM,
    actuators,
    fixes_of_track,
    sensor_columns,
)
from factory.importing.netcdf import (
    as_array,
    attributes_of,
    open_netcdf,
    seconds_of,
    text_of,
    unit_in,
)
from factory.importing.payload import payload_channels, payload_names
from factory.importing.pressures import pressure_by_flight, to_dbar
from factory.importing.seawater import ctd_channels, siemens
from factory.importing.tally import Tally, leave_out, note_empty, note_unread
from factory.importing.units import PRACTICAL, converted
from twin.errors import InputError

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


Array = NDArray[np.float64]
Columns = dict[str, Array]

CLOCK = "time"
ANGLES = {
    "measured_pitch": ("pitch", "platform_pitch", "m_pitch"),
    "measured_roll": ("roll", "platform_roll", "m_roll"),
    "measured_heading": ("heading", "platform_heading", "m_heading"),
}
"""Names of the attitude, where a file keeps it; a Slocum's own are radian, its heading magnetic."""
TRACKS = (("lat", "lon"), ("latitude", "longitude"))
FIXES = ("m_gps_lat", "m_gps_lon", "m_gps_status")
CTD = ("temperature", "salinity", "conductivity")
UNITS = {
    "pressure": "dbar", "depth": "m", "temperature": "degree_Celsius", "salinity": PRACTICAL,
    "conductivity": "S m-1", **{n: "degree" for pair in TRACKS for n in pair}, **SLOCUM_UNITS,
}  # fmt: skip
"""What variables are converted to by the units that a file declares; angles are judged together"""
SCALARS = ("profile_id", "profile_time", "trajectory", "u", "v", "time_uv")
"""Of a profile."""
READ = (
    CLOCK, "pressure", "depth", *CTD, *FIXES, *(n for pair in TRACKS for n in pair), *SCALARS,
    *(name for names in ANGLES.values() for name in names), *SLOCUM_SENSORS,
)  # fmt: skip
"""Variables that are read, beside those of the payload."""
_KIND = "NGDAC file"
_BAD = (3.0, 4.0, 9.0)
"""QARTOD flags: suspect, bad, missing."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NgdacProfile:
    """One file."""

    deployment: str
    columns: Columns
    """At `time`, unix seconds."""
    current: tuple[float, float, float] | None
    """Time [s], eastward and northward [m/s]."""
    attributes: dict[str, dict[str, Any]]
    platform: str
    """Model of the glider, where the file names it."""
    sensors: dict[str, str]
    """Names of columns by the actuator's sensor that they are of."""
    series: bool
    """Whether it is a whole deployment."""


def read_ngdac(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """One log for each deployment (`trajectory`) among the profiles.

    Raises:
      WrongFormat: another kind of file.
      InputError: no file can be read.
    """
    extra = payload_names(options.payload)
    profiles: dict[str, list[NgdacProfile]] = {}
    files: dict[str, list[str]] = {}
    for path, one in each_file(paths, lambda path: _profile(path, extra, tally), tally):
        profiles.setdefault(one.deployment, []).append(one)
        files.setdefault(one.deployment, []).append(path.name)
    filled = {
        name
        for several in profiles.values()
        for one in several
        for name, values in one.columns.items()
        if np.isfinite(values).any()
    }
    note_empty(_KIND, [n for n in (*READ, *extra) if n not in (*filled, *SCALARS)], tally)
    return [
        _log(name, several, files[name], options, extra, tally)
        for name, several in profiles.items()
    ]


def _profile(path: Path, extra: Sequence[str], tally: Tally) -> NgdacProfile:
    with open_netcdf(path) as file:
        file.set_auto_mask(True)
        variables = file.variables
        names = [*variables, *file.groups]
        if CLOCK not in variables or not {"profile_id", "profile_time", SERIES} & set(variables):
            raise WrongFormat(path, names)
        try:
            dimensions = variables[CLOCK].dimensions
            sensors = sensor_columns(variables)
            wanted = [n for n in (*READ, *sensors.values(), *extra) if n in variables]
            along = [
                n for n in wanted
                if variables[n].dimensions == dimensions and variables[n].dtype != str
                and variables[n].dtype.kind in "fiu"
            ]  # fmt: skip
            columns = {n: _unflagged(variables, n, tally) for n in along}
            attributes = {n: attributes_of(variables[n]) for n in along}
            flags = [f"{n}_qc" for n in along if f"{n}_qc" in variables]
            name = text_of(variables.get("trajectory")) or str(getattr(file, "id", path.stem))
            platform = str(getattr(file, "glider_model", "glider"))
            time = seconds_of(columns.pop(CLOCK), attributes[CLOCK], path.name, tally)
            units = {n: unit_in(attributes[n]) for n in columns}
            parts = {n: ACTUATORS[sensor] for sensor, n in sensors.items()}
            columns = converted(
                columns, units, UNITS | {n: part[1] for n, part in parts.items()}, tally,
                native={n: part[2] for n, part in parts.items()}, deployment=name,
            )  # fmt: skip
            current = _current(variables, path, name, tally)
        except (RuntimeError, OSError) as error:
            raise InputError(f"{path.name} is damaged: {' '.join(str(error).split())}") from error
    if not np.isfinite(time).any():
        raise InputError(f"{path.name} holds no measurement with a time")
    note_unread(_KIND, names, (*READ, *sensors.values(), *extra, *flags), tally)
    series = SERIES in names and not {"profile_id", "profile_time"} & set(names)
    what = "measurements" if series else "measurements of a profile"
    tally.add("read", path.name, len(time), what)
    return NgdacProfile(
        deployment=name,
        columns={CLOCK: time, **columns},
        current=current,
        attributes=attributes,
        platform=platform,
        sensors=sensors,
        series=series,
    )


def _unflagged(variables: Any, name: str, tally: Tally) -> Array:
    """Values without those that the file's own quality control calls bad, counted."""
    values = as_array(variables[name][:])
    flags = variables.get(f"{name}_qc")
    if flags is None or flags.shape != variables[name].shape or flags.dtype.kind not in "fiu":
        return values
    bad = np.isin(as_array(flags[:]), _BAD) & np.isfinite(values)
    tally.add("removed", name, int(bad.sum()), "flagged suspect or bad in the file")
    return np.where(bad, np.nan, values)


def _current(
    variables: Any, path: Path, deployment: str, tally: Tally
) -> tuple[float, float, float] | None:
    """Time, east and north of the segment's current; None where the file has none."""
    if not all(name in variables for name in ("u", "v", "time_uv")):
        return None
    u, v, time = (as_array(variables[name][...])[:1] for name in ("u", "v", "time_uv"))
    if not all(one.size and np.isfinite(one[0]) for one in (u, v, time)):
        return None
    when = seconds_of(time, attributes_of(variables["time_uv"]), f"{path.name} time_uv", tally)
    units = {n: unit_in(attributes_of(variables[n])) for n in ("u", "v")}
    found = converted(
        {"u": u, "v": v}, units, dict.fromkeys(units, "m s-1"), tally, deployment=deployment
    )
    if len(found) < len(units):
        return None
    east, north = (float(found[name][0]) for name in ("u", "v"))
    return (float(when[0]), east, north) if np.isfinite(east * north) else None


def _log(
    name: str,
    profiles: Sequence[NgdacProfile],
    files: Sequence[str],
    options: ReadOptions,
    extra: Sequence[str],
    tally: Tally,
) -> DeploymentLog:
    pieces = [one.columns for one in profiles]
    columns = stacked(pieces, sorted({n for piece in pieces for n in piece}))
    time, columns = tidy(columns.pop(CLOCK), columns, f"{name} profiles", tally)
    columns = with_values(columns)
    attributes: dict[str, dict[str, Any]] = {}
    for one in profiles:
        attributes |= one.attributes
    fixes = _fixes(time, columns, tally)
    track = _track(time, columns, tally)
    places = fixes
    if not len(fixes) and track:
        latitude = track["latitude"]
        places = LoggedFixes(latitude.time, latitude.values, track["longitude"].at(latitude.time))
    if track and not len(fixes) and "depth" in columns and all(one.series for one in profiles):
        latitude, longitude = track["latitude"], track["longitude"]
        known = np.isfinite(columns["depth"])
        depths = Channel(time[known], columns["depth"][known]).at(latitude.time)
        fixes, lines = fixes_of_track(
            latitude.time, latitude.values, longitude.values, depths, tally
        )
        track = {} if lines else track
    channels, variation = _attitude(name, time, columns, attributes, places, options, tally)
    channels |= actuators(time, columns, profiles[0].sensors, tally)
    depth = columns.get("depth")
    if depth is not None and np.nanmedian(depth) < 0.0:
        tally.add("repaired", "depth", int(np.isfinite(depth).sum()), "was positive up")
        depth = -depth
    pressure = columns.get("pressure")
    if pressure is not None:
        dbar = to_dbar(
            pressure, depth, "pressure", tally, native="dbar",
            declared=unit_in(attributes["pressure"]), deployment=name,
        )  # fmt: skip
        below = clean("measured_pressure", time, dbar, tally, subject="pressure")
        if depth is None:
            pitch = channels.get("measured_pitch", EMPTY)
            below = pressure_by_flight(below, pitch, "pressure", tally)
        channels["measured_pressure"] = below
    if depth is not None and not len(channels.get("measured_pressure", ())):
        channels["measured_depth"] = clean("measured_depth", time, depth, tally, subject="depth")
    channels |= _water(time, columns, channels, places, tally)
    sensors = {
        n: Channel(time[there], columns[n][there])
        for n in SLOCUM_SENSORS
        if n in columns and (there := np.isfinite(columns[n])).any()
    }
    channels |= slocum_batteries(sensors, tally)
    found = {
        n: Channel(time[there], columns[n][there])
        for n in extra
        if n in columns and (there := np.isfinite(columns[n])).any()
    }
    units = {n: unit_in(attributes[n]) for n in found}
    channels |= payload_channels(found, options.payload, tally, units=units)
    reported = sorted({one.current for one in profiles if one.current is not None})
    if reported:
        when, east, north = (np.array(part) for part in zip(*reported, strict=True))
        when, first = np.unique(when, return_index=True)
        # it is known when the vehicle has surfaced: at the end of its segment, not in the middle
        after = _ends(time, when)
        track |= {
            "dac_east": Channel(after, east[first]), "dac_north": Channel(after, north[first])
        }  # fmt: skip
    return DeploymentLog(
        deployment=name,
        platform=profiles[0].platform,
        channels={key: channel for key, channel in channels.items() if len(channel)},
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary=track,
        files=tuple(files),
    )


def _ends(time: Array, when: Array) -> Array:
    """[s] The last measurement before the next segment's, strictly increasing."""
    middle = np.append(0.5 * (when[1:] + when[:-1]), np.inf)
    at = np.clip(np.searchsorted(time, middle, side="right") - 1, 0, len(time) - 1)
    return np.maximum.accumulate(np.maximum(time[at], when) + 1e-3 * np.arange(len(when)))


def _fixes(time: Array, columns: Mapping[str, Array], tally: Tally) -> LoggedFixes:
    if not all(n in columns and np.isfinite(columns[n]).any() for n in FIXES[:2]):
        return NO_FIXES
    status = columns.get(FIXES[2], np.full(len(time), np.nan))
    bad = np.isfinite(status) & (status != 0.0)
    latitude, longitude = positions(columns[FIXES[0]], columns[FIXES[1]], "GPS fixes", tally)
    good = ~bad & np.isfinite(latitude) & np.isfinite(longitude)
    return LoggedFixes(time[good], latitude[good], longitude[good])


def _track(time: Array, columns: Mapping[str, Array], tally: Tally) -> dict[str, Channel]:
    """The file's own track."""
    there = [pair for pair in TRACKS if all(n in columns for n in pair)]
    best = next((p for p in there if np.isfinite(columns[p[0]]).any()), None)
    if best is None:
        return {}
    for pair in there:
        if pair != best:
            leave_out(pair, f"the track is {best[0]}, {best[1]}", tally)
    latitude, longitude = positions(columns[best[0]], columns[best[1]], ", ".join(best), tally)
    good = np.isfinite(latitude) & np.isfinite(longitude)
    return {
        "latitude": Channel(time[good], latitude[good]),
        "longitude": Channel(time[good], longitude[good]),
    }


def _attitude(
    name: str,
    time: Array,
    columns: Mapping[str, Array],
    attributes: Mapping[str, Mapping[str, Any]],
    places: LoggedFixes,
    options: ReadOptions,
    tally: Tally,
) -> tuple[dict[str, Channel], Channel]:
    """Attitude in degree, true heading, and the variation that was added."""
    channels: dict[str, Channel] = {}
    variation = EMPTY
    found = {
        target: [n for n in names if n in columns and np.isfinite(columns[n]).any()]
        for target, names in ANGLES.items()
    }
    angles = {
        target.removeprefix("measured_"): LoggedAngle(
            values=columns[there[0]],
            unit=unit_in(attributes[there[0]]),
            subject=there[0],
            native=_native_angle(there[0], attributes),
        )
        for target, there in found.items() if there
    }  # fmt: skip
    degrees = attitude_degrees(
        angles, time, columns.get("depth", columns.get("pressure")), tally, deployment=name
    )
    for target, there in found.items():
        kind = target.removeprefix("measured_")
        if kind not in degrees:
            continue
        leave_out(there[1:], f"{there[0]} is taken", tally)
        source = there[0]
        values, words = degrees[kind], attributes[source]
        sensor = str(words.get("source", source))
        said = " ".join(str(words.get(k, "")) for k in ("long_name", "comment", "standard_name"))
        if kind == "heading" and (sensor in MAGNETIC or "magnetic" in said.lower()):
            if options.variation_deg is not None:
                variation = Channel(time[:1], np.array([options.variation_deg]))
            else:
                variation = reference_declination(places, name, tally)
            if not len(variation):
                raise InputError(
                    f"{name}: {source} is magnetic, and no position is there from which the "
                    "variation follows; give it with --variation-deg, east positive"
                )
            values = np.mod(values + variation.at(time), 360.0)
        channels[target] = clean(target, time, values, tally, subject=source)
    return channels, variation


def _native_angle(name: str, attributes: Mapping[str, Mapping[str, Any]]) -> str:
    """Unit of an angle that declares none: pyglider writes a Slocum's as they are."""
    sensor = str(attributes[name].get("source", name))
    return "radian" if sensor.startswith(SLOCUM) else "degree"


def _water(
    time: Array,
    columns: Mapping[str, Array],
    channels: Mapping[str, Channel],
    places: LoggedFixes,
    tally: Tally,
) -> dict[str, Channel]:
    at = channels.get("measured_pressure") or channels.get("measured_depth") or EMPTY
    temperature = columns.get("temperature")
    if temperature is None or not len(at):
        return {}
    practical, conductivity = columns.get("salinity"), columns.get("conductivity")
    if conductivity is not None:
        if practical is not None:
            leave_out(["conductivity"], "salinity is there", tally)
        conductivity = siemens(conductivity, "conductivity", tally)
    latitude, longitude = places.at(time)
    return ctd_channels(
        time,
        temperature=temperature,
        pressure=at.at(time),
        practical=practical,
        conductivity=conductivity,
        latitude=latitude,
        longitude=longitude,
        tally=tally,
    )
