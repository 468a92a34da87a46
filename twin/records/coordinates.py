"""Coordinates: time and position of missions, in stores and in the provenance of trajectories.

A store has the coordinates `datetime`, `latitude` and `longitude` of every sample and
`start_time`, `start_latitude` and `start_longitude` of every mission, all in UTC and degrees WGS84.
The starts are the origins of the missions' frames. Stores of earlier versions lack some or all.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.geodesy import from_tangent_plane, wrap_longitude
from twin.numbers import Array
from twin.records.schema import MISSION

if TYPE_CHECKING:
    import xarray as xr


START_LATITUDE, START_LONGITUDE, START_TIME = "start_latitude", "start_longitude", "start_time"
"""Names of the frame's origin, in a trajectory's provenance and as arrays (mission) in stores"""
PLACE = (START_LATITUDE, START_LONGITUDE, START_TIME)
DATETIME, LATITUDE, LONGITUDE = "datetime", "latitude", "longitude"
"""Names of arrays (mission, time) in stores"""
COORDINATES = (DATETIME, LATITUDE, LONGITUDE)
NOMINAL = "start_nominal"
"""Entry that names the defaults among start place and date: a word of NOMINAL_WORDS in provenance,
an array (mission) of flags in a store. The entry is left out if neither is a default."""
NOMINAL_WORDS = ("none", "place", "date", "place and date")
"""Values of `start_nominal`, in the order of their flags"""
NOMINAL_ATTRIBUTES: Mapping[str, Any] = {
    "long_name": "default of the start that stands",
    "comment": "what nobody said of the start of the mission is a default",
    "flag_values": np.arange(len(NOMINAL_WORDS), dtype=np.int8),
    "flag_meanings": " ".join(word.replace(" ", "_") for word in NOMINAL_WORDS),
}

_EPOCH = np.datetime64("1970-01-01T00:00:00", "ms")
NO_TIME = np.int64(np.iinfo(np.int64).min)
"""Value of an unknown moment, which numpy and pandas read as NaT"""
MILLISECOND = 1e-3
_DEGREE_STEPS = 2.0**24
"""Steps in a degree: stored degrees are multiples of 6e-8 (7 mm); binary steps compress well"""

METHOD = "position_method"
"""Array (mission) in stores of logs with the method that gave the positions of each dive"""
METHODS: Mapping[str, str] = {
    "unknown": "no GPS fix",
    "straight_line": "straight line between the GPS fixes",
    "onboard_track": "the vehicle's own dead reckoning, corrected at the GPS fixes",
    "depth_rate_and_pitch": "dead-reckoned by depth rate, pitch and heading, corrected at the "
    "GPS fixes",
}
"""Meanings of the flags of `position_method`, in order"""
METHOD_ATTRIBUTES: Mapping[str, Any] = {
    "long_name": "method of the positions",
    "comment": "; ".join(f"{word}: {meaning}" for word, meaning in METHODS.items()),
    "flag_values": np.arange(len(METHODS), dtype=np.int8),
    "flag_meanings": " ".join(METHODS),
}
LOGGED = {
    "comment": f"found as {METHOD} says; the misclosure at the GPS fixes is spread linearly in time"
}
"""Attributes added to latitude and longitude of logs"""


def _described(standard: str, long_name: str, units: str, **more: Any) -> dict[str, Any]:
    return {"standard_name": standard, "long_name": long_name, "units": units, **more}


ATTRIBUTES: Mapping[str, Mapping[str, Any]] = {
    DATETIME: _described(
        "time", "date and time, UTC", "milliseconds since 1970-01-01",
        calendar="standard", axis="T", _FillValue=int(NO_TIME),
    ),
    LATITUDE: _described("latitude", "latitude", "degree_north", axis="Y"),
    LONGITUDE: _described("longitude", "longitude", "degree_east", axis="X"),
    START_TIME: _described(
        "time", "start time of the mission, UTC", "seconds since 1970-01-01", calendar="standard"
    ),
    START_LATITUDE: _described(
        "latitude", "latitude of the start of the mission", "degree_north"
    ),
    START_LONGITUDE: _described(
        "longitude", "longitude of the start of the mission", "degree_east"
    ),
}  # fmt: skip
"""CF attributes of each coordinate in stores"""
FLOWN = {"comment": "of the true track"}
"""Attributes added to latitude and longitude of simulated missions"""
COORDINATE_DTYPES = {name: np.dtype("<i8" if name == DATETIME else "<f8") for name in COORDINATES}
"""Type of each coordinate in stores"""


def rounded_degrees(values: Array) -> Array:
    """Round degrees to the steps of stores."""
    return np.asarray(np.rint(values * _DEGREE_STEPS) / _DEGREE_STEPS)


def unix_milliseconds(start: float, time: Array) -> NDArray[np.int64]:
    """Compute the moments of samples in unix milliseconds; NO_TIME if the start is unknown.

    Args:
      start: unix time [s] at `time` 0.
      time: [s], any shape.
    """
    if not np.isfinite(start):
        return np.full(np.shape(time), NO_TIME)
    return np.rint((start + time) / MILLISECOND).astype(np.int64)


def unix_seconds(moment: str | np.datetime64 | None) -> float:
    """Convert a moment (UTC, ISO 8601) to unix time [s]; NaN for None."""
    found: Any = moment
    since = np.datetime64("NaT" if moment is None else found, "us") - _EPOCH
    return float(since / np.timedelta64(1, "s"))


def utc_minute(unix: float) -> str:
    """Format a unix time [s] in UTC to the minute, such as 2023-09-20 06:31."""
    return f"{datetime.datetime.fromtimestamp(unix, datetime.UTC):%Y-%m-%d %H:%M}"


def utc_clock(unix: float, beside: float) -> str:
    """Format a unix time [s] as time of day, UTC; with the date if `beside` [s] is on another."""
    text = utc_minute(unix)
    return text[11:] if text[:10] == utc_minute(beside)[:10] else text[5:]


def flown_coordinates(
    time: Array, north: Array, east: Array, place: Mapping[str, Any]
) -> dict[str, NDArray[Any]]:
    """Compute the coordinates of a simulated mission's samples, (time,), in the form of stores.

    Args:
      time: [s] since the start, (time,).
      north, east: [m] from the origin, (time,).
      place: provenance of the mission; missing entries give NaN or NO_TIME.
    """
    origin = (place.get(START_LATITUDE, np.nan), place.get(START_LONGITUDE, np.nan))
    latitude, longitude = from_tangent_plane(north, east, *origin)
    return {
        DATETIME: unix_milliseconds(unix_seconds(place.get(START_TIME)), time),
        LATITUDE: rounded_degrees(latitude),
        LONGITUDE: rounded_degrees(wrap_longitude(longitude)),
    }


def padded(name: str, rows: Sequence[NDArray[Any]], longest: int) -> NDArray[Any]:
    """Stack one coordinate's values of several missions to (mission, time), with padding."""
    kind = COORDINATE_DTYPES[name]
    whole = np.full((len(rows), longest), NO_TIME if kind.kind == "i" else np.nan, kind)
    for k, row in enumerate(rows):
        whole[k, : len(row)] = row
    return whole


def sample_variables(
    arrays: Mapping[str, NDArray[Any]], said: Mapping[str, Any], dimensions: tuple[str, ...]
) -> dict[str, Any]:
    """Convert the coordinates of samples to xarray variables, with moments as datetime64.

    Args:
      arrays: coordinates by name, in the form of stores.
      said: attributes added to those of latitude and longitude.
      dimensions: dimensions of the arrays.
    """
    import xarray as xr

    variables: dict[str, Any] = {}
    for name, values in arrays.items():
        attributes = dict(ATTRIBUTES[name])
        if name != DATETIME:
            variables[name] = xr.Variable(dimensions, values, attributes | dict(said))
            continue
        encoding = {key: attributes.pop(key) for key in ("units", "calendar", "_FillValue")}
        moments = values.astype("datetime64[ms]")
        variables[name] = xr.Variable(
            dimensions, moments, attributes, encoding | {"dtype": "int64"}
        )
    return variables


def place_arrays(provenances: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Make arrays (mission) of start places and times; a name that no provenance has is left out.

    Args:
      provenances: provenance of each trajectory.
    """
    arrays: dict[str, Any] = {}
    for name in PLACE:
        if any(name in one for one in provenances):
            found = [one.get(name, None if name == START_TIME else np.nan) for one in provenances]
            values = [*map(unix_seconds, found)] if name == START_TIME else found
            arrays[name] = (MISSION, np.array(values, float), dict(ATTRIBUTES[name]))
    return arrays


def nominal_array(provenances: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Make the array (mission) `start_nominal`; no array if no place or date is a default."""
    if not any(NOMINAL in one for one in provenances):
        return {}
    flags = [NOMINAL_WORDS.index(one.get(NOMINAL, NOMINAL_WORDS[0])) for one in provenances]
    return {NOMINAL: (MISSION, np.array(flags, np.int8), dict(NOMINAL_ATTRIBUTES))}


def method_array(methods: Sequence[str]) -> Any:
    """Make the array (mission) `position_method` from words of METHODS."""
    flags = np.array([[*METHODS].index(word) for word in methods], np.int8)
    return MISSION, flags, dict(METHOD_ATTRIBUTES)


def read_place(one: xr.Dataset) -> dict[str, float | str]:
    """Read start place and time of one mission as provenance; times may be decoded or not.

    Raises:
      StoreError: an array of them cannot be decoded.
    """
    try:
        one = one[[name for name in (*PLACE, NOMINAL) if name in one]].load()
    except Exception as error:  # any error of a decoder means damaged files
        why = " ".join(str(error).split()) or type(error).__name__
        raise StoreError(
            f"the store is damaged: where and when a mission began cannot be read ({why}); "
            "`factory verify` names all damage: bring the files back from a copy, or make the "
            "store again"
        ) from error
    place: dict[str, float | str] = {}
    for name in (START_LATITUDE, START_LONGITUDE):
        if name in one and np.isfinite(value := float(one[name].values)):
            place[name] = value
    if START_TIME in one:
        start = np.asarray(one[START_TIME].values)
        if not np.issubdtype(start.dtype, np.datetime64):
            start = np.asarray(float(start) * 1e6).astype("datetime64[us]")
        if not np.isnat(start):
            place[START_TIME] = start.astype("datetime64[us]").item().isoformat()
    if NOMINAL in one and (flag := int(one[NOMINAL].values)):
        place[NOMINAL] = NOMINAL_WORDS[flag]
    return place
