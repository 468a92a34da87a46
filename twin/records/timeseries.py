"""Time series: missions of a store end to end over date and time, without padding.

A store keeps one row for each mission, padded to the longest mission. `timeseries` lays the rows
end to end for `sel(time=slice("2023-09-01", "2023-09-02"))`, `twin.resample(series, "1h")` and
`to_dataframe()`.

`resample` averages a time series over hours or days, with circular means for directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError
from twin.geodesy import from_tangent_plane, position, wrap_longitude
from twin.records.attributes import COMMENT
from twin.records.coordinates import (
    ATTRIBUTES,
    DATETIME,
    FLOWN,
    LATITUDE,
    LOGGED,
    LONGITUDE,
    START_LATITUDE,
    START_LONGITUDE,
    START_TIME,
    flown_coordinates,
    read_place,
    unix_milliseconds,
    unix_seconds,
)
from twin.records.logged import LogStore
from twin.records.reader import MissionStore
from twin.records.schema import MISSION, TIME
from twin.records.store import open_store
from twin.records.trajectory import sample_times

if TYPE_CHECKING:
    import xarray as xr


DEPTHS = ("measured_depth", "true_depth")
"""Signals for the variable `depth`, in order of preference for logs, in reverse for simulations."""
FIXES = ("measured_gps_north", "measured_gps_east")
"""[m] Fixes from a mission's start; a series has GPS_LATITUDE and GPS_LONGITUDE instead."""
GPS_LATITUDE, GPS_LONGITUDE = "gps_latitude", "gps_longitude"
FROM_THE_START = frozenset(
    f"{name}_{way}"
    for name in ("true", "measured_onboard", "commanded_waypoint")
    for way in ("north", "east")
) | {"measured_depth_time", "measured_attitude_time", "measured_ctd_time"}
"""Signals in metres or seconds from each mission's start. A series leaves them out, because they
would jump between missions; `latitude`, `longitude` and `time` replace them."""


def timeseries(store: str | Path | xr.Dataset, missions: Sequence[int] | None = None) -> xr.Dataset:
    """Join the samples of missions to one dataset over a dimension `time` of UTC moments.

    The variables are the store's signals, (time,), in their units, and `latitude`, `longitude`
    [degree], `depth` [m] and `mission`. Fixes are `gps_latitude` and `gps_longitude` [degree], NaN
    between fixes. Signals of FROM_THE_START are left out. Missions follow in the order of their
    starts. Missions that overlap, as in a simulated store, stay end to end, so `time` increases
    only within each mission: choose one mission, or use `sortby("time")`. With the extra `dask`,
    samples are read on access; without it, at once. Average with `twin.resample`.

    Args:
      store: path of a store of missions, simulated or logged, or the result of `twin.open_store`.
      missions: numbers of the missions, all by default.

    Raises:
      StoreError: the store cannot be read, lacks a mission, or lacks a mission's start time, as
        stores of earlier versions may.
      InputError: an empty list of missions.
    """
    import xarray as xr

    found = _open(store)
    lazy = open_store(found.path)
    chosen = list(range(len(found))) if missions is None else [int(m) for m in missions]
    if not chosen:
        raise InputError("timeseries: an empty list of missions; give numbers, or None for all")
    for mission in chosen:
        found.check_mission(mission)
    found.check_samples(chosen)
    rows = {mission: sample_coordinates(found, mission) for mission in chosen}
    for mission, row in rows.items():
        if np.isnat(row[DATETIME]).any():
            raise StoreError(
                f"store {found.path} does not say when mission {mission} began, so that it has "
                "no dates: make it again, or use the seconds of its coordinate time"
            )
    chosen.sort(key=lambda mission: rows[mission][DATETIME][0])
    names = [n for n in found.signals() if n not in FROM_THE_START and n not in FIXES]
    lengths = [int(found.samples[mission]) for mission in chosen]
    variables = {
        name: (TIME, _join_signal(found, lazy, name, chosen, lengths), _attributes(found, name))
        for name in names
    }
    said = LOGGED if found.logged else FLOWN
    places: dict[str, Any] = {
        name: (
            TIME,
            np.concatenate([rows[mission][name] for mission in chosen]),
            {n: v for n, v in ATTRIBUTES[name].items() if n != "axis"} | said,
        )
        for name in (LATITUDE, LONGITUDE)
    }
    order = DEPTHS if found.logged else DEPTHS[::-1]
    depth = next((name for name in order if name in variables), None)
    if depth is not None:
        _, values, about = variables[depth]
        about = {n: about[n] for n in ("units", "standard_name", "positive") if n in about}
        places["depth"] = TIME, values, {**about, "long_name": "depth", "comment": f"is {depth}"}
    places |= _fixes(found, chosen)
    places[MISSION] = TIME, np.repeat(chosen, lengths), {"long_name": "mission index"}
    attributes = {n: ATTRIBUTES[DATETIME][n] for n in ("standard_name", "long_name", "axis")}
    time = np.concatenate([rows[mission][DATETIME] for mission in chosen])
    moments = {TIME: (TIME, time.astype("datetime64[ns]"), attributes)}
    about = {name: text for name, text in found.attributes.items() if name in ABOUT}
    return xr.Dataset(places | variables, moments, {n: about[n] for n in ABOUT if n in about})


def sample_coordinates(store: MissionStore, mission: int) -> dict[str, NDArray[Any]]:
    """Read date and time (datetime64, UTC), latitude and longitude [degree], (samples,).

    Unknown values are NaT and NaN. Stores of earlier versions do not hold these coordinates: they
    are computed from the start and the track of the mission.

    Raises:
      StoreError: the store is damaged.
    """
    count = int(store.samples[mission])
    if DATETIME in store:
        return {n: store.row(n, mission)[:count] for n in (DATETIME, LATITUDE, LONGITUDE)}
    place = read_place(store.dataset.isel({MISSION: mission}))
    time = sample_times(count, store.period)
    if not store.logged:
        track = [store.row(f"true_{n}", mission)[:count].astype(float) for n in ("north", "east")]
        found = flown_coordinates(time, track[0], track[1], place)
        return {**found, DATETIME: found[DATETIME].astype("datetime64[ms]")}
    start = place.get(START_TIME)
    moments = unix_milliseconds(unix_seconds(None if start is None else str(start)), time)
    latitude, longitude, _ = LogStore(store.path).positions(mission)
    return {
        DATETIME: moments.astype("datetime64[ms]"),
        LATITUDE: latitude,
        LONGITUDE: longitude,
    }


def _fixes(store: MissionStore, missions: Sequence[int]) -> dict[str, Any]:
    """Latitude and longitude [degree] of the missions' fixes; empty for a store without fixes."""
    if any(name not in store for name in FIXES):
        return {}
    found = []
    for mission in missions:
        count = int(store.samples[mission])
        north, east = (store.row(name, mission)[:count].astype(float) for name in FIXES)
        place = read_place(store.dataset.isel({MISSION: mission}))
        origin = [float(place.get(n, np.nan)) for n in (START_LATITUDE, START_LONGITUDE)]
        # logs measure east along the parallel, simulated missions in the plane at their start
        degrees = (position if store.logged else from_tangent_plane)(north, east, *origin)
        found.append((degrees[0], wrap_longitude(degrees[1])))
    return {
        name: (
            TIME,
            np.concatenate([one[k] for one in found]),
            {"units": ATTRIBUTES[of]["units"], "standard_name": of,
             "long_name": f"{of} of the GPS fix", "comment": "NaN without a fix"},
        )
        for k, (name, of) in enumerate(((GPS_LATITUDE, LATITUDE), (GPS_LONGITUDE, LONGITUDE)))
    }  # fmt: skip


def _open(store: str | Path | xr.Dataset) -> MissionStore:
    """Open a store by its path, or by the dataset that `twin.open_store` returned."""
    if isinstance(store, str | Path):
        return MissionStore(store)
    source = store.encoding.get("source")
    if source is None:
        raise InputError("timeseries: give the path of a store, or what twin.open_store gave")
    return MissionStore(source)


def _attributes(store: MissionStore, name: str) -> dict[str, Any]:
    """Attributes of a signal, with `flag_values` in the array's type, which stores do not keep."""
    array = store.dataset[name]
    flags = {n: np.asarray(v, array.dtype) for n, v in array.attrs.items() if n == "flag_values"}
    return {**array.attrs, **flags}


def _join_signal(
    store: MissionStore, lazy: xr.Dataset, name: str, missions: list[int], lengths: list[int]
) -> Any:
    """Join a signal of missions end to end; with dask the samples are not read yet."""
    array = lazy[name].variable.transpose(MISSION, TIME)
    rows: Any = store.rows(name, missions) if array.chunks is None else array.data[list(missions)]
    return np.concatenate([row[:n] for row, n in zip(rows, lengths, strict=True)])


ABOUT = ("Conventions", "title", "source", COMMENT, "history", "platform")
"""Attributes of a store that a series keeps: its content and its origin"""
DIRECTION, HEADING = "platform_orientation", "_heading"
"""DIRECTION: standard name of headings. HEADING: ending of heading setpoints, which have none"""
FLAGS = ("measured_phase", "measured_dvl_mode", "commanded_segment")
"""Signals that number categories and lack the attribute `flag_values`"""
SHORTEST = 1e-9
"""[1] Smallest length of a mean unit vector; below it the mean direction is NaN."""


def resample(series: xr.Dataset, step: str) -> xr.Dataset:
    """Average a series of `twin.timeseries` over steps of time, each labelled by its beginning.

    Directions and longitudes are averaged on the circle (the angle of the mean unit vector;
    Mardia and Jupp 2000, Directional Statistics, eq. 2.2.4), without NaN. Where directions cancel,
    as opposite headings do, the mean is NaN. Categories (`mission`, phase, segment, lock of the
    Doppler log, flags) take the value of the step's first sample. All other variables have the
    arithmetic mean of their known samples. Steps without samples are NaN.

    Args:
      series: dataset over `time`, in any order.
      step: a length of time in the notation of pandas, "10min", "1h", "1D" or "MS" for months,
        or in words, "1 hour".

    Raises:
      InputError: no dataset over `time`, or a step that is not a length of time.
    """
    if TIME not in getattr(series, "indexes", {}) or series.indexes[TIME].dtype.kind != "M":
        raise InputError("resample: give what twin.timeseries gave, a dataset over UTC `time`")
    whole = series.sortby(TIME)
    step = _frequency(step)
    means = whole.resample({TIME: step}).mean(keep_attrs=True)
    names = [str(name) for name in whole.data_vars]
    kinds = (MISSION, *FLAGS)
    firsts = [name for name in names if name in kinds or "flag_values" in whole[name].attrs]
    if firsts:
        first = whole[firsts].resample({TIME: step}).first(keep_attrs=True)
        means = means.assign({name: first[name] for name in firsts})
    for name in names:
        about = whole[name].attrs
        standard = about.get("standard_name")
        named = standard == DIRECTION or name.endswith(HEADING)
        if standard == "longitude" or (named and about.get("units") == "degree"):
            mean = _circular(whole[name], step)
            means[name] = mean if standard == "longitude" else mean % 360.0
            means[name].attrs.update(about)
    return means[names]


def _frequency(step: str) -> str:
    """Translate a step to xarray's notation.

    Raises:
      InputError: the step is not a length of time.
    """
    import pandas as pd
    from pandas.tseries.frequencies import to_offset

    for read in (to_offset, lambda text: to_offset(pd.Timedelta(text))):
        try:
            # pandas reads a bare number as nanoseconds
            offset = read(step) if any(letter.isalpha() for letter in str(step)) else None
        except (ValueError, TypeError, AttributeError):
            continue
        if offset is not None and offset.n > 0:
            return str(offset.freqstr)
    raise InputError(
        f'resample: step {step!r} is not a length of time: give one such as "10min", "1h" or "1D"'
    )


def _circular(angle: xr.DataArray, step: str) -> xr.DataArray:
    """Mean direction of angles [degree] in each step, -180 to 180."""
    import xarray as xr

    radians = np.deg2rad(angle.astype(float))
    parts = xr.Dataset({"sine": np.sin(radians), "cosine": np.cos(radians)})
    means = parts.resample({TIME: step}).mean()
    length = np.hypot(means["sine"], means["cosine"])
    mean = xr.apply_ufunc(np.arctan2, means["sine"], means["cosine"], dask="parallelized")
    found: xr.DataArray = np.rad2deg(mean).where(length > SHORTEST)
    return found
