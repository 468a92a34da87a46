"""Logs of an imaginary Dorado, by what MB-System's mbauvloglist and MBARI's auv-python say of them:
a header of text and records of little-endian bytes, netCDF of each instrument, and a product."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import netCDF4
import numpy as np
from logs import Flight
from message_logs import DIVES, dives
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIZES = {"timeTag": "<f8", "double": "<f8", "angle": "<f8", "float": "<f4", "integer": "<i4",
         "short": "<i2"}  # fmt: skip
Field = tuple[str, str, Array]
"""Type as in a header, name, values"""


def instruments(
    time: Array, state: Mapping[str, Array], *, west: bool = False
) -> dict[str, list[Field]]:
    """Fields of each instrument's log, of a state in a store's units and axes.

    Args:
      west: whether the receiver counts longitudes westward, as those of the vehicle do.
    """
    nothing = np.zeros(len(time))
    rate = state.get("yaw_rate", nothing)
    pitch, roll = np.radians(state["pitch"]), np.radians(state.get("roll", nothing))
    heading = np.angle(np.exp(1j * np.radians(state["heading"])))
    north, east = track_of(time, state)
    found: dict[str, list[Field]] = {
        "navigation": [
            ("timeTag", "time", time), ("double", "mPos_x", 4_060_000.0 + north),
            ("double", "mPos_y", 600_000.0 + east), ("double", "mDepth", state["depth"]),
            ("integer", "mGpsValid", nothing), ("double", "mPhi", roll),
            ("double", "mTheta", pitch), ("double", "mPsi", heading),
            ("double", "mOmega_x", nothing + 0.01),
            ("double", "mOmega_y", nothing - 0.02), ("double", "mOmega_z", rate),
            ("double", "mWaterSpeed", nothing + 1.5),
        ],
        "tailCone": [
            ("timeTag", "time", time + 0.05), ("integer", "status", nothing),
            ("integer", "propRpm", np.round(state.get("rpm", nothing) * np.pi / 30.0)),
            ("float", "elevatorAngle", nothing + 0.06), ("float", "rudderAngle", nothing - 0.12),
        ],
    }  # fmt: skip
    if "latitude" in state:
        fixed = np.isfinite(state["latitude"])
        places = np.radians([np.nan_to_num(state[n]) for n in ("latitude", "longitude")])
        inside = np.flatnonzero(fixed)
        held = [np.interp(np.arange(len(time)), inside, one[inside]) for one in places]
        found["gps"] = [
            ("timeTag", "time", time), ("angle", "latitude", places[0]),
            ("angle", "longitude", -places[1] if west else places[1]),
            ("short", "quality", fixed.astype(float)), ("short", "numberOfSatellites", nothing + 8),
        ]  # fmt: skip
        found["navigation"] += [("double", "latitude", held[0]), ("double", "longitude", held[1])]
    return found


def track_of(time: Array, state: Mapping[str, Array]) -> tuple[Array, Array]:
    """North and east [m] of the vehicle's own track."""
    if "north" in state:
        return state["north"], state["east"]
    heading = np.radians(state["heading"])
    along, step = 1.5, np.diff(time, prepend=time[0])
    return np.cumsum(along * np.cos(heading) * step), np.cumsum(along * np.sin(heading) * step)


def write_log(path: Path, fields: Sequence[Field]) -> Path:
    """An instrument's log as the vehicle writes it."""
    lines = [f"# binary {path.name.partition('.')[0]}"]
    lines += [f"# {kind} {name} %8.8e ,{name} ,UNKNOWN" for kind, name, _ in fields]
    records = np.zeros(len(fields[0][2]), [(name, SIZES[kind]) for kind, name, _ in fields])
    for _, name, values in fields:
        records[name] = values
    path.write_bytes(("\n".join([*lines, "# begin"]) + "\n").encode() + records.tobytes())
    return path


def write_netcdf(path: Path, fields: Mapping[str, Array], time: Array) -> Path:
    """Variables along one time."""
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", len(time))
        for name, values in {"time": time, **fields}.items():
            variable = file.createVariable(name, "f8", ("time",))
            variable[:] = values
        file.variables["time"].units = "seconds since 1970-01-01T00:00:00Z"
    return path


def write_dorado(folder: Path, flight: Flight) -> list[Path]:
    """Dives as the vehicle's own logs, with the mapping that says that they are dives."""
    time, state = dives(flight)
    (folder / "mine.toml").write_text(DIVES)
    every = instruments(time, state, west=True)
    return [write_log(folder / f"{name}.log", fields) for name, fields in every.items()]


def write_dorado_netcdf(folder: Path, flight: Flight) -> list[Path]:
    """The same as netCDF of each instrument."""
    time, state = dives(flight)
    (folder / "mine.toml").write_text(DIVES)
    return [
        write_netcdf(folder / f"{name}.nc", {n: v for _, n, v in fields[1:]}, fields[0][2])
        for name, fields in instruments(time, state).items()
    ]


def write_dorado_product(folder: Path, flight: Flight) -> list[Path]:
    """The same as a product of one second, in degree."""
    time = np.arange(flight.time[0], flight.time[-1], 1.0)
    state = flight.state(time)
    latitude, longitude = flight.position(time)
    (folder / "mine.toml").write_text(DIVES)
    fields = {
        "depth": state["depth"], "latitude": latitude, "longitude": longitude,
        "navigation_pitch": state["pitch"], "navigation_roll": np.zeros(len(time)),
        "navigation_yaw": state["heading"], "ctd1_temperature": 12.0 - 0.05 * state["depth"],
        "ctd1_salinity": 33.5 + 0.01 * state["depth"], "navigation_mWaterSpeed": 1.0 + 0.0 * time,
    }  # fmt: skip
    return [write_netcdf(folder / "dorado_2011.256.02_1S.nc", fields, time)]


def names_in_log(path: Path) -> set[str]:
    """Names in the header of a vehicle's own log."""
    header = path.read_bytes().partition(b"# begin")[0].decode()
    return {line.split()[2] for line in header.splitlines()[1:]}
