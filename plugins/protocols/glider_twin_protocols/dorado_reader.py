"""Dorado reader: .log files of MBARI's Dorado vehicles, and netCDF files made from them.

A .log has a text header, with a line for each field and its type, and little-endian records of
these fields (MB-System's mbauvloglist; MBARI's auv-python). Every instrument has its own file, such
as navigation.log, tailCone.log or gps.log. auv-python converts each file to netCDF with the same
names, and all together to a product (`*_1S.nc`) with names such as `navigation_pitch`. A topic is
an instrument, or `track` for a product's variables without instrument.

Angles, angular rates and positions are in rad, even if the header has another unit; in products
they are in degree. `propRpm` is in rad/s (auv-python, `calibrate.py`). The units of rudder,
elevator and Doppler log are not published: they need a mapping.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.importing import (
    RECEIVER,
    TRUNCATED,
    DeploymentLog,
    ReadOptions,
    Signal,
    Tally,
    WrongFormat,
    each_file,
    expect_going,
    has_fix,
    note_unread,
    unit_to_take,
)
from factory.importing.messages import (
    MessageTable,
    log_of_messages,
    mapping_of,
    valued,
    wanted_fields,
    with_standard,
)
from factory.importing.netcdf import as_array, attributes_of, open_netcdf, seconds_of, unit_in
from twin.errors import InputError

Array = NDArray[np.float64]

MODEL = "tethys"
"""Vehicle file that replaces the vehicle's own if no mapping names another"""
GAP = 60.0
"""[s] Gap between two samples above which the vehicle was off and a new row begins"""
BEGIN = b"# begin"
LARGEST = 1e12
"""Largest possible value: times are in s, distances in m, pulses are counted"""
LONGEST_HEADER = 2**18
"""[byte] Longest header that is searched; the longest known has a hundredth"""
TYPES = {"timeTag": "<f8", "double": "<f8", "angle": "<f8", "float": "<f4", "integer": "<i4",
         "short": "<i2"}  # fmt: skip
NEAR = 0.05
"""[rad] Largest difference of longitude between GPS and the vehicle's track in a mission"""
PRODUCT = "navigation_"
"""Prefix of a product's variable names, which name the instrument first"""
TRACK = "track"
PRODUCT_PERIOD = 1.0
"""[s] Sample period of a resampled product, `_1S`"""

_Standard = tuple[str, str, str, str]
STANDARD: tuple[_Standard, ...] = (
    ("measured_roll", "navigation", "mPhi", "rad"),
    ("measured_pitch", "navigation", "mTheta", "rad"),
    ("measured_heading", "navigation", "mPsi", "rad"),
    ("measured_roll_rate", "navigation", "mOmega_x", "rad/s"),
    ("measured_pitch_rate", "navigation", "mOmega_y", "rad/s"),
    ("measured_yaw_rate", "navigation", "mOmega_z", "rad/s"),
    ("measured_depth", "navigation", "mDepth", "m"),
    ("measured_propeller", "tailCone", "propRpm", "rad/s"),
    ("measured_temperature", "fastcatlog", "temperature", "degC"),
    ("conductivity", "fastcatlog", "conductivity", "S/m"),
    ("gps_latitude", "gps", "latitude", "rad"),
    ("gps_longitude", "gps", "longitude", "rad"),
    ("latitude", "navigation", "latitude", "rad"),
    ("longitude", "navigation", "longitude", "rad"),
    ("latitude", "navigation", "latitudeNav", "rad"),
    ("longitude", "navigation", "longitudeNav", "rad"),
)
"""Signal, instrument, field and unit in the vehicle's own logs; a signal's first source counts"""
OF_PRODUCTS: tuple[_Standard, ...] = (
    ("measured_roll", "navigation", "roll", "deg"),
    ("measured_pitch", "navigation", "pitch", "deg"),
    ("measured_heading", "navigation", "yaw", "deg"),
    ("measured_depth", TRACK, "depth", "m"),
    ("measured_propeller", "tailcone", "propRpm", "rad/s"),
    ("measured_temperature", "ctd1", "temperature", "degC"),
    ("measured_salinity", "ctd1", "salinity", "1"),
    ("latitude", TRACK, "latitude", "deg"),
    ("longitude", TRACK, "longitude", "deg"),
)


class Instruments(NamedTuple):
    """Content of one file, by instrument."""

    product: bool
    tables: dict[str, MessageTable]
    """Values by instrument, with times [s] unix"""
    units: Mapping[str, str] = MappingProxyType({})
    """Units that a netCDF file declares, by `INSTRUMENT FIELD`"""


def read_dorado(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Read one log from each folder of instruments' files, and from each product.

    Raises:
      WrongFormat: a file is of another format.
      InputError: a file is damaged, has no known field, or contradicts the mapping.
    """
    missions: dict[tuple[Path, bool], dict[str, MessageTable]] = {}
    files: dict[tuple[Path, bool], list[Path]] = {}
    units: dict[str, str] = {}
    for path, found in each_file(paths, lambda one: _instruments(one, tally), tally):
        place = path.resolve() if found.product else path.resolve().parent
        known = missions.setdefault((place, found.product), {})
        twice = sorted(known.keys() & found.tables.keys())
        if twice:
            why = f"another file of the folder has {', '.join(twice)}"
            tally.add("left out", path.name, 1, why)
        known.update({name: one for name, one in found.tables.items() if name not in twice})
        files.setdefault((place, found.product), []).append(path)
        units |= found.units
    return [
        _log(place, product, files[place, product], tables, units, options, tally)
        for (place, product), tables in missions.items()
    ]


def _log(
    place: Path,
    product: bool,
    files: Sequence[Path],
    tables: dict[str, MessageTable],
    units: dict[str, str],
    options: ReadOptions,
    tally: Tally,
) -> DeploymentLog:
    mapping = mapping_of(options, "Dorado", MODEL, GAP)
    if options.mapping is None:
        tally.add("note", MODEL, 1, "stands for the vehicle; a --mapping may name another model")
    _turn_west(tables, tally)
    mapping = with_standard(mapping, _standard(tables, units, product, tally), tally)
    wanted = wanted_fields(mapping)
    for topic, table in tables.items():
        said = f"{topic}_" if product and topic != TRACK else ""
        receiver = [n for n in table.columns if topic == "gps" and n.lower() in RECEIVER]
        read = ["time", *(f"{said}{field}" for field in (*wanted.get(topic, ()), *receiver))]
        every = ["time", *(f"{said}{field}" for field in table.columns)]
        note_unread("Dorado product" if product else f"Dorado {topic}", every, read, tally)
    name = place.name.rpartition(".")[0] if product else place.name
    log = log_of_messages(files[0], name, sorted(tables), tables, mapping, options, tally)
    period = log.period or (PRODUCT_PERIOD if product else None)
    return dataclasses.replace(log, files=tuple(one.name for one in files), period=period)


def _standard(
    tables: dict[str, MessageTable], units: dict[str, str], product: bool, tally: Tally
) -> dict[str, Signal]:
    """Signals of the known fields; the track is in metres if there is no latitude and longitude.

    Units are those that a netCDF file declares, except for fields whose declared unit is wrong.
    """
    sources: dict[str, list[Signal]] = {}
    for signal, topic, field, unit in OF_PRODUCTS if product else STANDARD:
        if topic not in tables or field not in tables[topic].columns:
            continue
        column = f"{topic} {field}"
        sure = field == "propRpm" or (unit in ("rad", "rad/s") and not product)
        wanted = Signal(column=column).wanted(signal)
        said = "" if sure else units.get(column, "")
        taken = unit_to_take(said, wanted, column, tally, native=unit)
        if taken is not None:
            sources.setdefault(signal, []).append(Signal(column=column, unit=taken))
    found = valued(sources, tables, Tally())
    axes = {"onboard_north": "mPos_x", "onboard_east": "mPos_y"}
    known = tables["navigation"].columns if "navigation" in tables else {}
    if "latitude" not in found and set(axes.values()) <= set(known):
        found |= {s: Signal(column=f"navigation {f}", unit="m") for s, f in axes.items()}
    return found


def _turn_west(tables: dict[str, MessageTable], tally: Tally) -> None:
    """Change the sign of the GPS receiver's longitudes if they are positive westward, as the sign
    of the vehicle's own track shows."""
    nothing = MessageTable(np.zeros(0), {})
    gps, own = (tables.get(name, nothing) for name in ("gps", "navigation"))
    west = gps.columns.get("longitude", nothing.time)
    if not np.isfinite(west).any() or "navigation" not in tables:
        return
    every = [own.columns.get(name, nothing.time) for name in ("longitude", "longitudeNav")]
    track = [values for values in every if np.isfinite(values).any()]
    if not track:
        why = "taken as eastward: no track in degrees says its sign"
        tally.add("note", "gps longitude", 1, why)
        return
    there, here = np.nanmedian(west), np.nanmedian(track[0])
    if abs(there + here) < NEAR < abs(there - here):
        tables["gps"] = MessageTable(gps.time, {**gps.columns, "longitude": -west})
        why = "counted westward, by the vehicle's track"
        tally.add("repaired", "gps longitude", np.isfinite(west), why)


def _instruments(path: Path, tally: Tally) -> Instruments:
    if path.suffix.lower() != ".log":
        return _netcdf(path, tally)
    time, columns = _records(path, tally)
    topic = path.name.partition(".")[0]
    return Instruments(False, {topic: _valid(topic, MessageTable(time, columns), tally)})


def _records(path: Path, tally: Tally) -> tuple[Array, dict[str, Array]]:
    """Times and fields of a .log file; from a truncated file, all complete records."""
    data = path.read_bytes()
    start = data.find(BEGIN, 0, LONGEST_HEADER)
    begin = data.find(b"\n", start) + 1
    if start < 0 or not begin or not data.startswith(b"# "):
        raise WrongFormat(path, ())
    fields: list[tuple[str, str]] = []
    for line in data[:start].decode("latin-1").splitlines()[1:]:
        words = line.split()
        if len(words) < 3 or words[1] not in TYPES:
            what = words[1] if len(words) > 1 else "nothing"
            raise InputError(
                f"{path.name}: its header has a field of type {what!r}: {line.strip()!r}; known "
                f"are {', '.join(TYPES)}"
            )
        twice = any(words[2] == name for name, _ in fields)
        fields.append((f"{words[2]}_2" if twice else words[2], TYPES[words[1]]))
    if "time" not in dict(fields):
        raise InputError(f"{path.name} has no field time; it has {', '.join(dict(fields))}")
    if len(dict(fields)) < len(fields):
        raise InputError(f"{path.name}: its header names a field three times and more")
    kind = np.dtype(fields)
    whole, rest = divmod(len(data) - begin, kind.itemsize)
    if rest:
        tally.add("note", path.name, 1, f"{TRUNCATED}{rest} byte behind the last whole record")
    if not whole:
        raise InputError(f"{path.name} holds no record: its header alone")
    records = np.frombuffer(data, kind, whole, begin)
    columns = {name: _possible(records[name], path, tally) for name, _ in fields}
    return columns.pop("time"), columns


def _possible(stored: NDArray[Any], path: Path, tally: Tally) -> Array:
    """Values of a field, with NaN for values above LARGEST, which damaged bytes give."""
    with np.errstate(invalid="ignore"):
        values = stored.astype(np.float64)
        bad = np.abs(values) >= LARGEST
    return tally.removed(values, bad, path.name, "values beyond any measurement")


def _netcdf(path: Path, tally: Tally) -> Instruments:
    """Variables of a netCDF file by instrument, which is in a product's names or the file name."""
    with open_netcdf(path) as file:
        names = list(file.variables)
        product = any(name.startswith(PRODUCT) for name in names)
        tables: dict[str, MessageTable] = {}
        units: dict[str, str] = {}
        for name, variable in file.variables.items():
            clock = _clock(file, variable)
            if clock is None or clock is variable or variable.dtype.kind not in "fiu":
                continue
            time = seconds_of(as_array(clock[:]), attributes_of(clock), path.name, tally)
            topic, field = path.name.partition(".")[0], name
            if product:
                first, _, rest = name.partition("_")
                topic, field = (first, rest) if rest else (TRACK, name)
            units[f"{topic} {field}"] = unit_in(attributes_of(variable))
            table = tables.setdefault(topic, MessageTable(time, {}))
            if len(table.time) == len(time):
                found = {**table.columns, field: as_array(variable[:])}
                tables[topic] = MessageTable(table.time, found)
    if not tables:
        raise WrongFormat(path, names)
    for topic, table in tables.items():
        expect_going(f"time of {topic}", table.time, table.columns, path.name)
    return Instruments(product, {t: _valid(t, table, tally) for t, table in tables.items()}, units)


def _clock(file: Any, variable: Any) -> Any:
    """Time coordinate of a variable; None if it has none."""
    if len(variable.dimensions) != 1:
        return None
    name = variable.dimensions[0]
    return file.variables.get(name) if name.endswith("time") else None


def _valid(topic: str, table: MessageTable, tally: Tally) -> MessageTable:
    """Table in which a GPS receiver's positions without a fix are NaN."""
    if topic != "gps":
        return table
    unfixed = ~has_fix(table.columns, len(table.time))
    tally.add("removed", "GPS fixes", unfixed, "the receiver says that it has none")
    places = {
        name: np.where(unfixed, np.nan, table.columns[name])
        for name in ("latitude", "longitude") if name in table.columns
    }  # fmt: skip
    return MessageTable(table.time, {**table.columns, **places})
