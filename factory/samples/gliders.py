"""Gliders: write sample files of Slocum, Seaglider and SeaExplorer and of their base stations.

The layouts are those of public deployments: tables of a Slocum's sensors in native units, its
binary logs (read by dbdreader), Seaglider's base station 3 (p*.nc) and its tables, and .gli.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from factory.samples import START, Array, Flight, named, write_csv, write_netcdf

# --- Slocum -------------------------------------------------------------------------------------


def slocum_columns(flight: Flight) -> dict[str, Array]:
    """Return the columns of a Slocum's flight computer, with radian, bar, inch and cm3."""
    time, state = flight.time, flight.state(flight.time)
    return {
        "time": time,
        "m_depth": state["depth"],
        "m_pressure": state["depth"] * 1.0065 / 10.0,
        "m_pitch": np.radians(state["pitch"]),
        "m_roll": np.full(len(time), 0.02),
        "m_heading": np.radians(_magnetic(flight, state)),
        "m_battpos": np.where(state["pitch"] < 0, 0.4, -0.4),
        "m_ballast_pumped": state["pump"],
        "m_fin": np.full(len(time), 0.1),
    }


def gps_columns(flight: Flight) -> dict[str, Array]:
    """Return the columns of a Slocum's receiver: fixes [degree], variation west positive [rad]."""
    time = flight.time[flight.state(flight.time)["under"] == 0.0]
    latitude, longitude = flight.position(time)
    return {
        "time": time,
        "lat": latitude,
        "lon": longitude,
        "status": np.zeros(len(time)),
        "mag_var_rad": np.full(len(time), -np.radians(flight.variation)),
    }


def write_slocum(
    folder: Path,
    flight: Flight,
    name: str = "unit1",
    rows: Any = slice(None),
    gps: Mapping[str, Array] | None = None,
    **changes: Array | None,
) -> list[Path]:
    """Write a table of the flight and a table of the fixes.

    Args:
      name: name of the vehicle.
      rows: rows of the flight table to write.
      gps: columns that replace the flight's own fixes.
      changes: columns that replace those of the flight table; None leaves a column out.
    """
    columns = {**slocum_columns(flight), **changes}
    kept = {key: values[rows] for key, values in columns.items() if values is not None}
    return [
        write_csv(folder / f"{name}_flight.csv", kept),
        write_csv(folder / f"{name}_gps.csv", gps or gps_columns(flight)),
    ]


def write_dbd(
    folder: Path,
    flight: Flight,
    vehicle: str = "unit_1",
    *,
    columns: Mapping[str, Array] | None = None,
    crc: str = "0badcafe",
    without: Sequence[str] = (),
    factored: bool = True,
) -> list[Path]:
    """Write a binary flight log and its cache file, with sensors in native units and GPS.

    The log has 14 lines of text, then the tag `s` with numbers that show the byte order. Each cycle
    has the tag `d`, two bits per sensor (0 no value, 1 unchanged, 2 new) and the new values.

    Args:
      columns: columns of a science log (.ebd) that replace all sensors; time first.
      crc: checksum of the list of sensors, which is the name of the cache file.
      without: sensors to leave out.
      factored: whether the list of sensors is only in the cache file, not also after the header.
    """
    gps, flown = gps_columns(flight), slocum_columns(flight)
    ending = "dbd" if columns is None else "ebd"
    if columns is None:
        columns = {"m_present_time": flown.pop("time"), **flown, **gps_sensors(gps)}
    names = {name: values for name, values in columns.items() if name not in without}
    cache = folder / f"{crc}.cac"
    cache.write_text("".join(f"s: T {k} {k} 8 {name} nodim\n" for k, name in enumerate(names)))
    state_bytes = (len(names) + 3) // 4
    header = {
        "dbd_label": "DBD(dinkum_binary_data)file", "encoding_ver": 5, "num_ascii_tags": 14,
        "all_sensors": "F", "the8x3_filename": "00010000",
        "full_filename": f"{vehicle}-2023-317-0-0", "filename_extension": ending,
        "mission_name": "TEST.MI", "fileopen_time": "Tue_Nov_14_22:13:20_2023",
        "total_num_sensors": len(names), "sensors_per_cycle": len(names),
        "state_bytes_per_cycle": state_bytes, "sensor_list_crc": crc,
        "sensor_list_factored": int(factored),
    }  # fmt: skip
    data = bytearray("".join(f"{k}: {v}\n" for k, v in header.items()).encode())
    if not factored:
        data += cache.read_bytes()
    data += b"sa" + struct.pack("<hfd", 0x1234, 123.456, 123456789.12345)
    at_surface = {time: row for row, time in enumerate(gps["time"])}
    for row, time in enumerate(next(iter(names.values()))):
        fix = at_surface.get(time)
        states, values = bytearray(state_bytes), []
        for k, (name, column) in enumerate(names.items()):
            at = fix if name.startswith("m_gps") else row
            if at is not None:
                states[k // 4] |= 2 << (6 - 2 * (k % 4))
                values.append(float(column[at]))
        data += b"d" + states + struct.pack(f"<{len(values)}d", *values)
    path = folder / f"{vehicle}-2023-317-0-0.{ending}"
    path.write_bytes(bytes(data) + b"X")
    return [path, cache]


def gps_sensors(gps: Mapping[str, Array]) -> dict[str, Array]:
    """Rename `gps_columns` to the sensors of a binary log, with positions as ddmm.mmm."""
    return {
        "m_gps_lat": nmea(gps["lat"]), "m_gps_lon": nmea(gps["lon"]),
        "m_gps_status": gps["status"], "m_gps_mag_var": gps["mag_var_rad"],
    }  # fmt: skip


def nmea(degrees: Array) -> Array:
    """Convert decimal degrees to ddmm.mmm."""
    whole = np.trunc(degrees)
    return whole * 100.0 + (degrees - whole) * 60.0


def _magnetic(flight: Flight, state: Mapping[str, Array]) -> Array:
    """[degree] Heading from magnetic north."""
    return np.mod(state["heading"] - flight.variation, 360.0)


SLOCUM = {"csv": write_slocum, "dbd": write_dbd}

# --- Seaglider ----------------------------------------------------------------------------------


def _dives(flight: Flight) -> Iterator[tuple[int, Array, Array]]:
    """Yield each dive's number, the times [s] of its samples under water and of GPS 1, 2 and E."""
    for dive in range(flight.dives):
        start, end = flight.dive_times(dive)
        fixes = np.array([start - flight.surface + 100.0, start - 40.0, end + 60.0])
        yield dive + 1, np.arange(start + 5.0, end, 10.0), fixes


def _reported(flight: Flight) -> dict[str, float]:
    """Numbers of each dive by their names at the base station."""
    return {
        "magnetic_variation": flight.variation,
        "depth_avg_curr_north": flight.north,
        "depth_avg_curr_east": flight.east,
        "log_C_PITCH": 2000.0,
        "log_PITCH_CNV": 0.003,
    }


def write_seaglider(folder: Path, flight: Flight, name: str = "SG999") -> list[Path]:
    """Write a table of samples (under water only) and one of dives, named after the vehicle."""
    times, dives = [], []
    for number, time, fixes in _dives(flight):
        times.append(time)
        row: dict[str, Any] = {"glider": name, "dive": number}
        for fix, *values in zip(
            ("gps1", "gps2", "gpsE"), fixes, *flight.position(fixes), strict=True
        ):
            keys = (f"{fix}_{key}" for key in ("time", "lat", "lon"))
            row |= dict(zip(keys, map(float, values), strict=True))
        dives.append(row | _reported(flight))
    time = np.concatenate(times)
    state = flight.state(time)
    samples: dict[str, Any] = {
        "glider": [name] * len(time),
        "dive": state["dive"] + 1,
        "time": time,
        "depth_m": state["depth"],
        "pressure_dbar": state["depth"] * 1.0085,
        "pitch_deg": state["pitch"],
        "roll_deg": np.zeros(len(time)),
        "head_mag_deg": _magnetic(flight, state),
        "vbd_cc": state["pump"],
        "gc_pitch_ctl_cm": np.where(state["pitch"] < 0, -0.6, 0.6),
        "gc_pitch_ad": np.where(state["pitch"] < 0, 1800.0, 2200.0),
        "temp_c": np.full(len(time), 8.0),
        "sal_psu": np.full(len(time), 34.0),
    }
    return [
        write_csv(folder / f"{name.lower()}_samples.csv", samples),
        write_csv(
            folder / f"{name.lower()}_dives.csv",
            {key: [row[key] for row in dives] for key in dives[0]},
        ),
    ]


def write_basestation(folder: Path, flight: Flight, number: int = 999) -> list[Path]:
    """Write a file for each dive: samples under water, and actuator positions after each move.

    The bladder and the battery move once, at the deepest point.
    """
    paths = []
    for dive, time, fixes in _dives(flight):
        state, (start, _) = flight.state(time), flight.dive_times(dive - 1)
        latitude, longitude = flight.position(fixes)
        columns: dict[str, dict[str, Any]] = {
            "sg_data_point": {
                "time": time,
                "pressure": state["depth"] * 1.0085,
                "depth": state["depth"],
                "eng_pitchAng": state["pitch"],
                "eng_rollAng": np.zeros(len(time)),
                "eng_head": _magnetic(flight, state),
                "eng_vbdCC": state["pump"],
            },
            "ctd_data_point": {
                "ctd_time": time + 1.0,
                "temperature": np.full(len(time), 8.0),
                "salinity": np.full(len(time), 34.0),
            },
            "gc_event": {
                "gc_end_secs": [start, start + flight.leg],
                "gc_pitch_ctl": [-0.6, 0.6],
                "gc_vbd_ctl": [-230.0, 230.0],
                "gc_pitch_ad": [1800.0, 2200.0],
                "gc_roll_ad": [2000.0, 2000.0],
            },
            "gps_info": {
                "log_gps_time": fixes, "log_gps_lat": latitude, "log_gps_lon": longitude
            },
        }  # fmt: skip
        numbers = _reported(flight) | {
            "log_C_ROLL_DIVE": 2000.0, "log_C_ROLL_CLIMB": 2000.0, "log_ROLL_CNV": 0.028
        }  # fmt: skip
        variables: dict[str, Any] = {
            name: ((dimension,), values)
            for dimension, some in columns.items()
            for name, values in some.items()
        }
        variables |= {name: ((), value) for name, value in numbers.items()}
        variables["log_TGT_LATLONG"] = (("letters",), "4936.000,-5800.000")
        path = folder / f"p{number:03d}{dive:04d}.nc"
        platform = f"SG{number}"
        paths.append(write_netcdf(path, variables, platform_id=platform, dive_number=dive))
    return paths


SEAGLIDER = {"csv": write_seaglider, "basestation": write_basestation}

# --- SeaExplorer --------------------------------------------------------------------------------


def write_seaexplorer(path: Path, flight: Flight, delimiter: str = ",") -> Path:
    """Write a navigation log (.gli) with a row every 10 s; under water it repeats the last fix."""
    time = np.arange(START, flight.time[-1], 10.0)
    state = flight.state(time)
    under = state["under"] > 0.0
    latitude, longitude = flight.position(time)
    last = np.maximum.accumulate(np.where(under, 0, np.arange(len(time))))
    return write_csv(
        path,
        {
            "Timestamp": [f"{datetime.fromtimestamp(t, UTC):%d/%m/%Y %H:%M:%S}" for t in time],
            "NavState": np.where(under, np.where(state["pitch"] < 0, 100, 117), 116),
            "Heading": _magnetic(flight, state),
            "Declination": np.full(len(time), flight.variation),
            "Pitch": state["pitch"],
            "Roll": np.zeros(len(time)),
            "Depth": state["depth"],
            "Lat": np.round(nmea(latitude[last]), 4),
            "Lon": np.round(nmea(longitude[last]), 4),
            "DesiredH": np.full(len(time), -9999.0),
            "BallastPos": state["pump"],
            "LinPos": np.where(state["pitch"] < 0, 60.0, 20.0),
            "AngPos": np.full(len(time), 5.0),
        },
        delimiter,
    )


SEAEXPLORER = {"gli": named(write_seaexplorer, "sea009_M3_gli.csv")}
