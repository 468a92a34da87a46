"""Archives: write sample files of data centres, and tables that need a mapping.

The formats are OceanGliders' OG1.0, profiles of the U.S. IOOS National Glider DAC, time series of
pyglider, and binned files of spraydata.ucsd.edu.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from factory.samples import MAPPING, START, Array, Flight, named, write_csv, write_netcdf

OF_1990 = "seconds since 1990-01-01T00:00:00Z"
ZERO = 631_152_000.0
"""[s] Unix time of 1990-01-01"""


def write_og1(path: Path, flight: Flight) -> Path:
    """Write an OG1.0 file with radians, minutes since 1970, and a magnetic heading."""
    time, state = flight.with_fixes()
    latitude, longitude = state["latitude"], state["longitude"]
    minutes, samples = "minutes since 1970-01-01", ("N_MEASUREMENTS",)
    magnetic = {"long_name": "magnetic heading", "units": "degree"}
    return write_netcdf(
        path,
        {
            "TIME": (samples, time / 60.0, minutes),
            "DEPTH": (samples, state["depth"], "m"),
            "PITCH": (samples, np.radians(state["pitch"]), "rad"),
            "HEADING": (samples, state["heading"] - flight.variation, magnetic),
            "LATITUDE_GPS": (samples, latitude),
            "LONGITUDE_GPS": (samples, longitude),
            "TIME_GPS": (samples, np.where(np.isnan(latitude), np.nan, time / 60.0), minutes),
        },
    )


OG1 = {"netcdf": named(write_og1, "deployment.nc")}


def write_ngdac(folder: Path, flight: Flight) -> list[Path]:
    """Write a file for each descent and each climb, with CF names and seconds since 1990."""
    time = flight.time
    state = flight.state(time)
    latitude, longitude = flight.position(time)
    paths = []
    for dive in range(flight.dives):
        start, end = flight.dive_times(dive)
        middle = start + flight.leg
        for first, last in ((start - 60.0, middle), (middle, end + 60.0)):
            inside = (time >= first) & (time < last)
            count = int(inside.sum())
            series = {
                "time": (time[inside] - ZERO, OF_1990),
                "depth": (state["depth"][inside], "m"),
                "pressure": (1.0065 * state["depth"][inside], "dbar"),
                "temperature": (np.full(count, 8.0), "Celsius"),
                "salinity": (np.full(count, 34.0), "1"),
                "lat": (latitude[inside], "degrees_north"),
                "lon": (longitude[inside], "degrees_east"),
                "pitch": (state["pitch"][inside], "degrees"),
                "heading": (state["heading"][inside], "degrees"),
            }
            variables: dict[str, Any] = {n: (("time",), *one) for n, one in series.items()}
            variables |= {
                "trajectory": (("letters",), "unit-23"),
                "depth_qc": (("time",), np.ones(count, np.int8)),
                "profile_id": ((), 2.0 * dive + (first == middle)),
                "profile_time": ((), 0.5 * (first + last) - ZERO),
                "profile_lat": ((), latitude[inside].mean()),
                "profile_lon": ((), longitude[inside].mean()),
                "u": ((), flight.east),
                "v": ((), flight.north),
                "time_uv": ((), 0.5 * (start + end) - ZERO, OF_1990),
                "lat_uv": ((), latitude[inside].mean()),
                "lon_uv": ((), longitude[inside].mean()),
            }
            paths.append(write_netcdf(folder / f"glider_{int(first)}_rt.nc", variables))
    return paths


def write_pyglider(
    path: Path, flight: Flight, *, pump: bool = True, reckoned: bool = False
) -> Path:
    """Write a time series of pyglider, for a SeaExplorer or a Slocum.

    Args:
      pump: True if the file has the ballast's position.
      reckoned: True for a Slocum, with radians and positions that meander between fixes and are
        20 m wrong at the end of a dive; False for positions on lines between the fixes.
    """
    time = flight.time
    state = flight.state(time)
    at_surface = state["under"] == 0.0
    latitude, longitude = flight.position(time)
    if reckoned:
        wrong = np.where(at_surface, 0.0, (time - START) % flight.cycle - flight.surface)
        minute = np.arange(time[0], time[-1] + 60.0, 60.0)  # a Slocum logs positions every minute
        meander = np.where(at_surface, 0.0, np.interp(time, minute, 5.0 * np.sin(minute)))
        latitude = latitude + (wrong / (2.0 * flight.leg) * 20.0 + meander) / 111e3
    else:
        latitude, longitude = (
            np.interp(time, time[at_surface], values[at_surface])
            for values in (latitude, longitude)
        )
    angle: Any = np.radians if reckoned else np.asarray
    heading = np.mod(state["heading"] - flight.variation, 360.0)
    series: dict[str, tuple[Array, str, str, str]] = {  # values, units, name in Slocum, SeaExplorer
        "time": (time, "seconds since 1970-01-01T00:00:00Z", "time", "time"),
        "latitude": (latitude, "degrees_north", "m_lat", "NAV_LATITUDE"),
        "longitude": (longitude, "degrees_east", "m_lon", "NAV_LONGITUDE"),
        "depth": (state["depth"], "m", "", ""),
        "pressure": (1.0065 * state["depth"], "dbar", "GPCTD_PRESSURE", "GPCTD_PRESSURE"),
        "temperature": (
            np.full(len(time), 8.0), "Celsius", "GPCTD_TEMPERATURE", "GPCTD_TEMPERATURE"
        ),
        "salinity": (np.full(len(time), 34.0), "1", "", ""),
        "pitch": (angle(state["pitch"]), "degrees", "m_pitch", "Pitch"),
        "roll": (angle(np.full(len(time), 1.0)), "degrees", "m_roll", "Roll"),
        "heading": (angle(heading), "degrees", "m_heading", "Heading"),
        "ballast": (state["pump"], "cm3", "m_ballast_pumped", "BallastPos"),
        "profile_index": (2.0 * state["dive"] + (state["pitch"] > 0.0), "1", "", ""),
        "profile_direction": (-np.sign(state["pitch"]), "1", "", ""),
        "distance_over_ground": (np.zeros(len(time)), "km", "", ""),
    }  # fmt: skip
    variables = {}
    for name, (values, units, *sources) in series.items():
        source = sources[0 if reckoned else 1]
        if pump or name != "ballast":
            about = {"units": units, "source": source} if source else {"units": units}
            variables[name] = (("time",), values, about)
    return write_netcdf(path, variables, glider_model="Slocum" if reckoned else "SeaExplorer")


NGDAC = {"profiles": write_ngdac, "pyglider": named(write_pyglider, "series.nc")}


def write_spray(path: Path, flight: Flight, missions: Sequence[int] = (7,)) -> Path:
    """Write a Spray's binned file: the middle of each dive, and a profile of the climb every 10 m.

    The time and place of a profile are those of the climb's middle. Each further mission begins a
    year later."""
    bins = np.arange(10.0, flight.depth + 20.0, 10.0)
    year = 366.0 * 86400.0
    rows: list[list[float]] = []
    for number, mission in enumerate(missions):
        for dive in range(flight.dives):
            fixes = np.array(flight.dive_times(dive))
            tracks = (fixes + year * number, *flight.position(fixes))
            middle = [0.5 * (v[0] + v[1]) for v in tracks]
            profile = [0.25 * v[0] + 0.75 * v[1] for v in tracks]
            rows.append([*profile, *middle, flight.east, flight.north, float(mission)])
    names = (
        "time", "lat", "lon", "time_uv", "lat_uv", "lon_uv", "u_depth_mean", "v_depth_mean",
        "mission",
    )  # fmt: skip
    since = ["seconds since 1970-01-01T00:00:00Z"]
    variables: dict[str, Any] = {"depth": (("depth",), bins)}
    for name, column in zip(names, zip(*rows, strict=True), strict=True):
        variables[name] = (("profile",), column, *(since if name.startswith("time") else ()))
    for name, values in (("temperature", 15.0 - 0.02 * bins), ("salinity", 33.0 + 0.0 * bins)):
        climbed = np.where(bins <= flight.depth, values, np.nan)
        variables[name] = (("depth", "profile"), np.repeat(climbed[:, None], len(rows), axis=1))
    return write_netcdf(path, variables)


SPRAY = {"binned": named(write_spray, "CUGN_line_90.nc")}


def table_columns(flight: Flight) -> dict[str, Array]:
    """Return the columns of a table for `TABLE_MAPPING`: forward-left-up, headings from east."""
    time, state = flight.with_fixes()
    return {
        "stamp": (time - START) * 1e3,
        "z": state["depth"] * 100.0,
        "theta": -np.radians(state["pitch"]),
        "yaw": np.radians(90.0 - state["heading"]),
        "r": np.full(len(time), -0.5),
        "vx": np.where(state["under"] > 0.0, state["speed"] / 0.514444, -99.0),
        "engine": state["pump"] / 1000.0,
        "lat": state["latitude"],
        "lon": state["longitude"],
        "ax": np.zeros(len(time)),
        "comment": np.zeros(len(time)),
    }


TABLE_MAPPING = """
vehicle = "my AUV"
frame = "FLU"
deployment = "file"
rows = "dives"
gap_s = 60
period_s = 1
[time]
column = "stamp"
unit = "ms"
start = 2023-11-14T22:13:20Z
[signals]
measured_depth = { column = "z", unit = "cm" }
measured_pitch = { column = "theta", unit = "rad" }
measured_heading = { column = "yaw", unit = "rad", zero = "east", turns = "counterclockwise" }
measured_yaw_rate = { column = "r", unit = "deg/s" }
measured_dvl_surge = { column = "vx", unit = "knots", sentinels = [-99], possible = [-3, 3] }
measured_pump = { column = "engine", unit = "l", held = true }
gps_latitude = { column = "lat", unit = "deg", optional = true }
gps_longitude = { column = "lon", unit = "deg", optional = true }
[ignored]
"a[xyz]" = "differences of vx: no measurement"
[[corrections]]
files = "2023-12*"
signal = "measured_yaw_rate"
sign = -1
reason = "the gyroscope was mounted upside down in December"
"""
"""Mapping for the table; docs/howto/import_tables.md shows it."""


def write_table(folder: Path, flight: Flight) -> list[Path]:
    """Write a table of an arbitrary vehicle, and the mapping that reads it."""
    (folder / MAPPING).write_text(TABLE_MAPPING)
    return [write_csv(folder / "log.csv", table_columns(flight))]


TABLES = {"table": write_table}
