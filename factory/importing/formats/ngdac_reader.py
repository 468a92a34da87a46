"""NGDAC reader: netCDF profiles of the IOOS National Glider DAC, and pyglider's time series.

All profile files of a deployment make one log; a time series is a whole deployment. Names and units
are CF's. Positions are the data assembly's track, interpolated between surfacings. GPS fixes are
known only if a file keeps the vehicle's own `m_gps_lat`, `m_gps_lon` (decimal degrees or ddmm.mmm).
A segment's current, `u` and `v` at `time_uv`, is repeated in each of its profiles.

The data assembly's ERDDAP serves many profiles in one table (`row`, `obs`, ragged arrays). There,
`time`, `latitude` and `longitude` are the profile's; `precise_time`, `precise_lat` and
`precise_lon` are the sample's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import (
    LoggedAngle,
    attitude_degrees,
    calls_itself_magnetic,
    reference_declination,
)
from factory.importing.cleaning import clean, downward
from factory.importing.columns import stacked, tidy, with_values
from factory.importing.deployment_log import (
    EMPTY,
    NO_FIXES,
    Channel,
    DeploymentLog,
    LoggedFixes,
    each_file,
)
from factory.importing.formats.base import ReadOptions, WrongFormat, other_format
from factory.importing.formats.ngdac_profiles import (
    ACTUATORS,
    FIXES,
    MAGNETIC,
    RECKONS,
    SERIES,
    SLOCUM,
    TRACKS,
    actuators,
    by_standard_name,
    currents_of,
    fixes_in,
    fixes_of_track,
    place_once,
    profile_numbers,
    reported_currents,
    sensor_columns,
    track_in,
)
from factory.importing.formats.slocum.choices import SLOCUM_SENSORS, SLOCUM_UNITS, slocum_batteries
from factory.importing.netcdf import Geometry, attributes_of, open_netcdf, unit_in
from factory.importing.payload import payload_channels, payload_names
from factory.importing.pressures import ctd_channels, pressure_channels, siemens
from factory.importing.sample_clock import sample_clock
from factory.importing.tally import Tally, leave_out, note_empty, note_unread
from factory.importing.units import PRACTICAL, converted
from twin.errors import InputError

Array = NDArray[np.float64]
Columns = dict[str, Array]

CLOCK = "time"
ANGLES = {
    "pitch": ("pitch", "platform_pitch", "m_pitch"),
    "roll": ("roll", "platform_roll", "m_roll"),
    "heading": ("heading", "platform_heading", "m_heading"),
}
PRECISE = "precise_time"
CTD = ("temperature", "salinity", "conductivity")
UNITS = {
    "pressure": "dbar", "depth": "m", "temperature": "degree_Celsius", "salinity": PRACTICAL,
    "conductivity": "S m-1", "u": "m s-1", "v": "m s-1",
    **{n: "degree" for pair in TRACKS for n in pair}, **SLOCUM_UNITS,
}  # fmt: skip
"""Units that variables are converted to, from the declared ones; angles are judged together."""
CURRENT = ("u", "v", "time_uv")
SCALARS = ("profile_id", "profile_time", "profile_lat", "profile_lon", "trajectory", *CURRENT)
"""Variables with one value for a profile."""
MEASURED = ("pressure", "depth", *CTD)
"""Variables at the samples."""
NEEDS = "such a file has time, and depth or pressure at the same samples"
READ = (
    CLOCK, PRECISE, *MEASURED, *FIXES, *(n for pair in TRACKS for n in pair), *SCALARS,
    *(name for names in ANGLES.values() for name in names), *SLOCUM_SENSORS,
)  # fmt: skip
"""Variables that are read, besides the payload's."""
_KIND = "NGDAC file"
_BAD = (3.0, 4.0, 9.0)
"""QARTOD flags: suspect, bad, missing."""


class NgdacProfile(NamedTuple):
    """Samples and currents of one deployment in one file."""

    columns: Columns
    """Values by name, at `time` in unix seconds."""
    currents: list[tuple[float, float, float]]
    """End of each profile [s] unix, and its segment's current eastward and northward [m/s]; NaN
    where it has none."""
    attributes: dict[str, dict[str, Any]]
    platform: str
    """Model of the glider, if the file names it."""
    sensors: dict[str, str]
    """Names of columns, by the actuator's sensor."""
    series: bool
    """True if the file holds a whole deployment."""


def read_ngdac(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Make one log for each deployment (`trajectory`) among the profiles.

    Raises:
      WrongFormat: a file is of another kind.
      InputError: no file can be read.
    """
    extra = payload_names(options.payload)
    profiles: dict[str, list[NgdacProfile]] = {}
    files: dict[str, list[str]] = {}
    filled: set[str] = set()
    for path, several in each_file(paths, lambda path: _profiles(path, extra, tally), tally):
        for deployment, one in several.items():
            profiles.setdefault(deployment, []).append(one)
            files.setdefault(deployment, []).append(path.name)
            filled |= {*with_values(one.columns)}
    note_empty(_KIND, [n for n in (*READ, *extra) if n not in (*filled, PRECISE, *SCALARS)], tally)
    return [
        _log(name, several, files[name], options, extra, tally)
        for name, several in profiles.items()
    ]


def _profiles(path: Path, extra: Sequence[str], tally: Tally) -> dict[str, NgdacProfile]:
    """Read one file; return its profiles by deployment."""
    with open_netcdf(path) as file:
        file.set_auto_mask(True)
        variables = file.variables
        names = [*variables, *file.groups]
        aliases = by_standard_name(variables, READ)
        geometry = Geometry(file, [aliases.get(n, n) for n in MEASURED], path.name)
        sensors = sensor_columns(variables)
        wanted = dict.fromkeys((*READ, *sensors.values(), *extra))
        source = {name: aliases.get(name, name) for name in wanted}
        along = [n for n in wanted if geometry.reaches(source[n])]
        if not {"depth", "pressure"} & set(along) or not {CLOCK, PRECISE} & set(along):
            raise WrongFormat(path, names, why=NEEDS)
        columns = {n: _unflagged(geometry, source[n], tally) for n in along}
        attributes = {n: attributes_of(variables[source[n]]) for n in along}
        flags = [f"{source[n]}_qc" for n in along if f"{source[n]}_qc" in variables]
        single = {n for n in along if geometry.single(source[n])}
        owners = geometry.texts("trajectory")
        name = str(getattr(file, "id", path.stem))
        platform = str(getattr(file, "glider_model", "glider"))
        one = {*owners} if owners is not None else {name}
        deployment = (one.pop() or name) if len(one) == 1 else ""
        units = {n: unit_in(attributes[n]) for n in columns}
        parts = {n: ACTUATORS[one] for one, n in sensors.items() if one in ACTUATORS}
        columns = converted(
            columns, units, UNITS | {n: part[1] for n, part in parts.items()}, tally,
            native={n: part[2] for n, part in parts.items()}, deployment=deployment,
        )  # fmt: skip
        sampled = {n: columns[n] for n in MEASURED if n in columns and n not in single}
        note_unread(_KIND, names, (*wanted, *aliases.values(), *flags), tally)
        clocks = {
            n: np.where(np.isnan(columns.get(n, seconds)), np.nan, seconds)  # time flagged bad
            for n, seconds in geometry.clocks(CLOCK, tally).items()
        }
        with other_format(path, names):
            clock = sample_clock(clocks, sampled, path.name, tally)
    if clock != CLOCK and CLOCK in clocks:
        leave_out([CLOCK], f"a profile's; {clock} is the sample's", tally)
    time = clocks[clock]
    unknown = np.full(len(time), np.nan)
    when = next((clocks[n] for n in (CLOCK, "profile_time") if n in clocks and n != clock), unknown)
    number = profile_numbers(
        len(time), [when, *(columns[n] for n in ("profile_id", *CURRENT) if n in columns)]
    )
    for pair in TRACKS:
        repeated = clock != CLOCK and pair != TRACKS[0]
        if set(pair) <= set(columns) and (set(pair) <= single or repeated):
            place_once(columns, pair, when, time)
    series = SERIES in names and not {"profile_id", "profile_time"} & set(names)
    what = "measurements" if series else "measurements of a profile"
    tally.add("read", path.name, len(time), what)
    every = np.full(len(time), name, object) if owners is None else np.where(owners, owners, name)
    found = {}
    for owner in dict.fromkeys(every):
        mine = {n: values[every == owner] for n, values in {**columns, CLOCK: time}.items()}
        currents = currents_of(mine, number[every == owner], mine[CLOCK])
        kept = {n: values for n, values in mine.items() if n not in _OF_PROFILE}
        found[owner] = NgdacProfile(kept, currents, attributes, platform, sensors, series)
    return found


_OF_PROFILE = frozenset({PRECISE, "profile_id", "profile_time", "trajectory", *CURRENT})
"""Variables that are dropped once the profiles are known."""


def _unflagged(geometry: Geometry, name: str, tally: Tally) -> Array:
    """Remove values that the file's own quality control calls suspect or bad; count them."""
    values = geometry.column(name)
    if not geometry.reaches(f"{name}_qc"):
        return values
    bad = np.isin(geometry.column(f"{name}_qc"), _BAD) & np.isfinite(values)
    return tally.removed(values, bad, name, "flagged suspect or bad in the file")


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
    attributes = {n: words for one in profiles for n, words in one.attributes.items()}
    sensors = profiles[0].sensors
    depth, pressure = columns.get("depth"), columns.get("pressure")
    fixes = fixes_in(time, columns, tally)
    track = track_in(time, columns, tally)
    places = fixes if len(fixes) else track
    if len(track) and not len(fixes) and depth is not None and all(one.series for one in profiles):
        flag = columns.get(sensors.get(RECKONS, ""))
        fixes, lines = fixes_of_track(
            track, Channel.finite(time, depth).at(track.time), tally,
            reckons=None if flag is None else flag[np.searchsorted(time, track.time)],
        )  # fmt: skip
        track = NO_FIXES if lines else track
    channels, variation = _attitude(name, time, columns, attributes, places, options, tally)
    channels |= actuators(time, columns, sensors, tally)
    if depth is not None:  # the pressure is compared with the depth
        depth = downward(depth, "depth", tally)
    channels |= pressure_channels(
        time, pressure, depth, "pressure", tally, depth_subject="depth", deployment=name,
        pitch=channels.get("measured_pitch", EMPTY),
        declared="" if pressure is None else unit_in(attributes["pressure"]),
    )  # fmt: skip
    channels |= _water(time, columns, channels, places, tally)
    valued = {n: Channel.finite(time, columns[n]) for n in columns}
    channels |= slocum_batteries({n: valued[n] for n in SLOCUM_SENSORS if n in valued}, tally)
    found = {n: valued[n] for n in extra if n in valued}
    units = {n: unit_in(attributes[n]) for n in found}
    channels |= payload_channels(found, options.payload, tally, units=units)
    reported = reported_currents([end for one in profiles for end in one.currents], fixes)
    return DeploymentLog(
        deployment=name,
        platform=profiles[0].platform,
        channels=channels,
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary=(track.channels() if len(track) else {}) | reported,
        files=tuple(files),
    )


def _attitude(
    name: str,
    time: Array,
    columns: Mapping[str, Array],
    attributes: Mapping[str, Mapping[str, Any]],
    places: LoggedFixes,
    options: ReadOptions,
    tally: Tally,
) -> tuple[dict[str, Channel], Channel]:
    """Attitude in degree with true heading, and the variation that was added."""
    channels: dict[str, Channel] = {}
    variation = EMPTY
    sources = {kind: [n for n in names if n in columns] for kind, names in ANGLES.items()}
    sensors = {n: str(attributes[n].get("source", n)) for names in sources.values() for n in names}
    angles = {
        kind: LoggedAngle(
            values=columns[there[0]],
            unit=unit_in(attributes[there[0]]),
            subject=there[0],
            # pyglider keeps a Slocum's radian, and declares no unit
            native="radian" if sensors[there[0]].startswith(SLOCUM) else "degree",
        )
        for kind, there in sources.items() if there
    }  # fmt: skip
    depth = columns.get("depth", columns.get("pressure"))
    degrees = attitude_degrees(angles, time, depth, tally, deployment=name)
    for kind in [kind for kind in ANGLES if kind in degrees]:
        source, *others = sources[kind]
        leave_out(others, f"{source} is taken", tally)
        values = degrees[kind]
        if kind == "heading" and (
            sensors[source] in MAGNETIC or calls_itself_magnetic(attributes[source])
        ):
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
        target = f"measured_{kind}"
        channels[target] = clean(target, time, values, tally, subject=source)
    return channels, variation


def _water(
    time: Array,
    columns: Mapping[str, Array],
    channels: Mapping[str, Channel],
    places: LoggedFixes,
    tally: Tally,
) -> dict[str, Channel]:
    at = channels.get("measured_pressure") or channels.get("measured_depth") or EMPTY
    temperature, practical = columns.get("temperature"), columns.get("salinity")
    if temperature is None or not len(at):
        return {}
    conductivity = columns.get("conductivity")
    if conductivity is not None:
        if practical is not None:
            leave_out(["conductivity"], "salinity is there", tally)
        conductivity = siemens(conductivity, "conductivity", tally)
    latitude, longitude = places.at(time)
    return ctd_channels(
        time, temperature=temperature, pressure=at.known(time), practical=practical,
        conductivity=conductivity, latitude=latitude, longitude=longitude, tally=tally,
    )  # fmt: skip
