"""OG1 reader: OceanGliders OG1.0 netCDF files, also those of `factory export`.

The format's names are upper case. Positions along the track are the glider's own; fixes are in
LATITUDE_GPS and LONGITUDE_GPS. Angles are degrees; actuators have the units that they declare.
Files of our own export also state the grid from which they were written.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.flight_terms import MADE_CONDUCTIVITY
from factory.exporting.og1.og1_terms import TERMS, VARIATION
from factory.exporting.og1.variables import ENDING
from factory.importing.angles import LoggedAngle, attitude_degrees
from factory.importing.cleaning import clean, downward
from factory.importing.columns import tidy, with_values
from factory.importing.deployment_log import (
    EMPTY,
    NO_FIXES,
    Channel,
    DeploymentLog,
    each_file,
    places_for,
)
from factory.importing.formats.base import ReadOptions, WrongFormat, other_format
from factory.importing.formats.og1.derived import (
    STORED,
    Variation,
    ctd,
    deployed,
    dives_in,
    fixes_apart,
    fixes_in,
    oxygen_per_volume,
    stored_columns,
    tracks_in,
    true_heading,
    with_start,
)
from factory.importing.formats.og1.vocabulary import (
    ALIASES,
    CONDUCTIVITIES,
    CORRECTED,
    CURRENTS,
    DEPLOYED,
    DIMENSION,
    ORIGINAL_TIMES,
    OURS,
    OWN_TRACK,
    READ,
    RECKONED,
    REPORTED,
    SALINITIES,
    TEMPERATURES,
    TRUE_TRACK,
    WAYPOINT,
    deployment_words,
    flags_of,
    leave_out_made_again,
    without_bad,
)
from factory.importing.netcdf import (
    SINCE,
    as_array,
    attributes_of,
    is_number,
    open_netcdf,
    seconds_of,
    text_of,
    unit_in,
)
from factory.importing.payload import payload_channels, payload_names
from factory.importing.pressures import pressure_by_flight, to_dbar
from factory.importing.sample_clock import sample_clock
from factory.importing.tally import Tally, leave_out, note_empty, note_unread
from factory.importing.units import converted, declared, is_of, unit_of
from twin.errors import InputError
from twin.records.schema import VARIABLES, declare_stored

Array = NDArray[np.float64]

PLACES = (
    "LATITUDE", "LONGITUDE", "LATITUDE_GPS", "LONGITUDE_GPS", *OWN_TRACK, *WAYPOINT, *TRUE_TRACK,
)  # fmt: skip
UNITS = {
    **{n: unit_of("measured_temperature") for n in TEMPERATURES},
    **{n: unit_of("measured_salinity") for n in SALINITIES},
    **dict.fromkeys(CONDUCTIVITIES, "S m-1"),
    **dict.fromkeys(CURRENTS.values(), "m s-1"),
    **dict.fromkeys(PLACES, "degree"),
    VARIATION: "degree",
}
"""Units that variables are converted to, if they are no signals themselves."""
ATTITUDE = {f"measured_{kind}": kind for kind in ("pitch", "roll", "heading")}


def own_signals(attributes: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Map file names to store names, for signals that an export writes as the store has them.

    An unknown part or payload is declared as the file describes it.
    """
    found = {}
    for name, described in attributes.items():
        if "signal_group" in described and name not in OURS:
            stored = name.lower()
            declare_stored(stored, described)
            if stored in VARIABLES and VARIABLES[stored].units == described.get("units"):
                found[name] = stored
    return found


def signals_in(
    time: Array,
    columns: Mapping[str, Array],
    attributes: Mapping[str, Mapping[str, Any]],
    variation: Variation,
    path: Path,
    tally: Tally,
) -> tuple[dict[str, Channel], set[str], Channel]:
    """Channels, the names of the variables used, and the variation that was added."""

    def in_store(name: str, wanted: str, tally: Tally) -> Array | None:
        unit = unit_in(attributes[name])
        return declared(columns[name], unit, wanted, name, tally, deployment=deployment)

    applied, deployment = EMPTY, variation.deployment
    known = {**OURS, **own_signals(attributes)}
    sources = {target: name for name, target in known.items() if name in columns}
    for target, names in ALIASES.items():
        found = next((n for n in names if n in columns and np.isfinite(columns[n]).any()), None)
        if found is not None:
            sources[target] = found
    name_of_depth = sources.get("measured_depth", "")
    depth = in_store(name_of_depth, "m", tally) if name_of_depth in columns else None
    if depth is not None:  # the pressure is compared with the depth
        depth = downward(depth, name_of_depth, tally)
    below = depth
    if below is None and (name := sources.get("measured_pressure")) is not None:
        below = in_store(name, "dbar", Tally())
    angles = {
        kind: LoggedAngle(
            values=columns[sources[target]], unit=unit_in(attributes[sources[target]]),
            subject=sources[target],
        )
        for target, kind in ATTITUDE.items() if target in sources
    }  # fmt: skip
    attitude = attitude_degrees(angles, time, below, tally, deployment=deployment)
    channels: dict[str, Channel] = {}
    for target, name in sources.items():
        if target in ATTITUDE:
            values = attitude.get(ATTITUDE[target])
        elif target == "measured_depth":
            values = depth
        elif name in UNITS:  # converted before
            values = columns[name]
        else:
            values = in_store(name, unit_of(target), tally)
        if values is None:
            continue
        if target == "measured_pressure":
            values = to_dbar(
                values, depth, name, tally, native="dbar", declared=unit_in(attributes[name]),
                deployment=deployment,
            )  # fmt: skip
        if target == "measured_heading":
            values, applied = true_heading(values, time, attributes[name], variation, path, tally)
        channels[target] = clean(target, time, values, tally, subject=name)
    pressure = channels.get("measured_pressure", EMPTY)
    if depth is None and len(pressure):
        pitch, name = channels.get("measured_pitch", EMPTY), sources["measured_pressure"]
        channels["measured_pressure"] = pressure_by_flight(pressure, pitch, name, tally)
    if depth is not None and len(pressure):
        channels.pop("measured_depth", None)  # computed from pressure, as for every log
    return channels, set(sources.values()), applied


def read_og1(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Make one log for each file, as the format's unit is a deployment.

    Raises:
      WrongFormat: a file is of another kind.
      InputError: a file is damaged.
    """
    logs = [log for _, log in each_file(paths, lambda path: _file(path, options, tally), tally)]
    kept: list[DeploymentLog] = []
    for log in sorted(logs, key=lambda one: -sum(map(len, one.channels.values()))):
        same = [one for one in kept if one.deployment == log.deployment and _overlap(one, log)]
        if same:
            why = f"files: {same[0].files[0]} holds more of {log.deployment} at the same time"
            tally.add("left out", log.files[0], 1, f"{why}: another version, or a copy")
        else:
            kept.append(log)
    counts = Counter(log.deployment for log in kept)
    for name in sorted(name for name in counts if counts[name] > 1):
        tally.add("note", name, counts[name], "files of one deployment: rows of each kept")
    return [log for log in logs if any(log is one for one in kept)]


def _overlap(one: DeploymentLog, other: DeploymentLog) -> bool:
    """Tell whether the times of two logs with channels overlap."""
    if not one.channels or not other.channels:
        return False
    (first, last), (begin, end) = one.span, other.span
    return first < end and begin < last


def _file(path: Path, options: ReadOptions, tally: Tally) -> DeploymentLog:
    with open_netcdf(path) as file:
        variables = file.variables
        names = list(variables)
        if "TIME" not in variables or DIMENSION not in file.dimensions:
            why = f"an OG1.0 file has TIME along the dimension {DIMENSION}"
            raise WrongFormat(path, [*names, *file.groups], why=why)
        raw = {
            name: as_array(variable[:])
            for name, variable in variables.items()
            if variable.dimensions == (DIMENSION,) and is_number(variable)
            and not name.endswith(ENDING)
        }  # fmt: skip
        attributes = {name: attributes_of(variables[name]) for name in raw}
        flags = flags_of(variables, raw)
        name = _deployment(file, path)
        said = deployment_words(file, name)
        platform = text_of(variables.get("PLATFORM_MODEL")) or str(
            getattr(file, "platform", "underwater glider")
        )
        simulated = "simul" in str(getattr(file, "title", "")).lower()
        ours = CORRECTED in raw
        begun = deployed(variables) if ours else NO_FIXES
        apart = fixes_apart(variables, path.name, tally)
    for key, values in raw.items():
        values = without_bad(key, values, flags, tally)
        raw[key] = _within_limits(key, values, attributes[key], tally)
    clock = _clock(path, raw, attributes, names, tally)
    time, columns = raw.pop(clock), dict(raw)
    for key in ("TIME_GPS", *ORIGINAL_TIMES.values()):
        if np.isfinite(raw.get(key, np.zeros(0))).any():
            columns[key] = seconds_of(raw[key], attributes[key], path.name, tally)
    time = seconds_of(time, attributes[clock], path.name, tally)
    if not np.isfinite(columns.get("TIME_GPS", np.zeros(0))).any():
        columns["TIME_GPS"] = time  # fixes are at the measurements' times
    if ours:
        columns |= stored_columns(columns, flags)
    else:
        for alias, standard in REPORTED.items():
            if alias in columns and standard not in columns:
                columns[standard] = columns.pop(alias)
                attributes[standard] = attributes[alias]
    time, columns = tidy(time, columns, path.name, tally)
    units = {n: unit_in(described) for n, described in attributes.items()}
    columns = with_values(columns, ("TIME_GPS",))
    columns = converted(columns, units, UNITS, tally, deployment=name)
    tally.add("read", path.name, len(time), "measurements")
    extra = payload_names(options.payload)
    own = own_signals(attributes)
    read = (*READ, *own, *extra, *TERMS["sensors"], *(f"{n}{ENDING}" for n in ("TIME", *flags)))
    read = (*read, "PHASE", *DEPLOYED) if ours else (*read, RECKONED, *REPORTED)
    note_unread("OG1 file", names, read, tally)
    leave_out_made_again(names, read, tally)
    leave_out(["TIME"] if clock != "TIME" else [], f"{clock} is the samples' time", tally)
    empty = [n for n, values in raw.items() if not np.isfinite(values).any()]
    note_empty("OG1 file", empty, tally)
    if simulated:
        tally.add("note", path.name, 1, "its title says that it is simulated, not observed")
    fixes = with_start(fixes_in(time, columns, tally) or apart, begun)
    series = {n: Channel.finite(time, values) for n, values in columns.items()}
    track = tracks_in(time, columns, tally)
    stored = series.get(VARIATION, EMPTY)
    variation = Variation(options.variation_deg, places_for(fixes, track), name, stored)
    channels, used, applied = signals_in(time, columns, attributes, variation, path, tally)
    made = attributes.get("CNDC", {}).get("long_name", "") == MADE_CONDUCTIVITY
    water, from_ctd = ctd(time, columns, channels, fixes, tally, own_conductivity=ours and not made)
    dense = channels.get("measured_density") if ours else None
    channels |= water
    if dense is not None:  # includes the store's values while the CTD was off
        channels["measured_density"] = dense
    found = {n: series[n] for n in extra if n in series}
    if PER_MASS in found:  # 1 m is near enough to 1 dbar here
        pressure = channels.get("measured_pressure") or channels.get("measured_depth") or EMPTY
        found[PER_MASS] = oxygen_per_volume(
            found[PER_MASS], attributes[PER_MASS], PER_MASS, water, pressure, tally
        )
        if is_of(units[PER_MASS], "umol kg-1"):
            units[PER_MASS] = "umol L-1"
    channels |= payload_channels(found, options.payload, tally, units=units)
    known = {n for names in ALIASES.values() for n in names} | {*TEMPERATURES, *SALINITIES}
    known |= {*CONDUCTIVITIES, *OURS}
    unused = [n for n in raw if n in known - used - from_ctd and n not in empty]
    made_of = [n for n in unused if n in CONDUCTIVITIES]
    leave_out(made_of, "salinity is there, and is not made of it", tally)
    unused = [n for n in unused if n not in made_of]
    leave_out(unused, "another variable of the file gives it", tally)
    track |= dives_in(time, columns, fixes, tally)
    track |= {f"{kind}_original": series.get(n, EMPTY) for kind, n in ORIGINAL_TIMES.items()}
    track |= {kind: series.get(kind, EMPTY) for kind in STORED}
    return DeploymentLog(
        deployment=name,
        platform=platform,
        channels={key: channel for key, channel in channels.items() if len(channel)},
        fixes=fixes,
        magnetic_variation=applied,
        auxiliary=track,
        files=(path.name,),
        # an export has a grid, with zeroed depth and rows between fixes
        station=ours or "seaglider" in platform.lower() or bool(_SEAGLIDER.match(name)),
        period=float(np.median(np.diff(time))) if ours and len(time) > 1 else None,
        gridded=ours,
        simulated=simulated,
        said=said,
    )


def _clock(
    path: Path,
    raw: Mapping[str, Array],
    attributes: Mapping[str, Mapping[str, Any]],
    names: Sequence[str],
    tally: Tally,
) -> str:
    """Name of the samples' clock; TIME if it is a clock of the samples.

    Raises:
      WrongFormat: every clock stands for the profiles, as those of a Spray's bins do.
    """
    if "TIME" not in raw:
        raise WrongFormat(path, names, why=f"its TIME is no number along {DIMENSION}")
    clocks = {"TIME": seconds_of(raw["TIME"], attributes["TIME"], path.name, Tally())}
    for name in raw:
        if SINCE in str(attributes[name].get("units", "")):
            with contextlib.suppress(InputError):  # units of no time: no clock
                clocks.setdefault(name, seconds_of(raw[name], attributes[name], "", Tally()))
    measured = {name: values for name, values in raw.items() if name not in clocks}
    with other_format(path, names):
        return sample_clock(clocks, measured, path.name, tally)


PER_MASS = "DOXY"


def _deployment(file: Any, path: Path) -> str:
    for source in ("TRAJECTORY", "trajectory"):
        text = text_of(file.variables.get(source))
        if text and not re.fullmatch(r"[\d.\[\]]+", text):
            return text
    return str(getattr(file, "id", path.stem))


def _within_limits(name: str, values: Array, attributes: Mapping[str, Any], tally: Tally) -> Array:
    """Remove values outside the variable's own valid range; count them."""
    low = -np.inf if name == "DEPTH" else float(attributes.get("valid_min", -np.inf))
    bad = (values < low) | (values > float(attributes.get("valid_max", np.inf)))
    return tally.removed(values, bad, name, "outside the file's valid range")


_SEAGLIDER = re.compile(r"sg\d{3}(_|$)", re.IGNORECASE)
"""Pattern of the names of a Seaglider's deployments."""
