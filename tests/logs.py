"""Logs of an imaginary glider in the layouts of real ones, written by the tests of the import."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.geodesy import from_tangent_plane

Array = NDArray[np.float64]

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
START = 1_700_000_000.0
LATITUDE, LONGITUDE = 49.5, -58.0


@dataclasses.dataclass(frozen=True)
class Flight:
    """What the imaginary glider did: saw-tooth dives with a drift at the surface before each.

    Glides at `speed` along the pitch, in a uniform current; the heading is `heading` degree.
    """

    dives: int = 3
    depth: float = 60.0
    pitch: float = 26.0
    speed: float = 0.4
    heading: float = 40.0
    north: float = 0.08
    east: float = -0.05
    surface: float = 300.0
    step: float = 4.0
    variation: float = -20.0

    @property
    def leg(self) -> float:
        return self.depth / (self.speed * np.sin(np.radians(self.pitch)))

    @property
    def cycle(self) -> float:
        return self.surface + 2.0 * self.leg

    @property
    def time(self) -> Array:
        end = self.dives * self.cycle + self.surface
        return START + np.arange(0.0, end, self.step)

    def state(self, time: Array) -> dict[str, Array]:
        """Truth at unix times: depth, pitch, pump, north, east ..."""
        since = time - START
        cycle = np.minimum(np.floor(since / self.cycle), self.dives)
        local = since - cycle * self.cycle
        dive = np.clip(local - self.surface, 0.0, 2.0 * self.leg)
        under = (dive > 0.0) & (cycle < self.dives)
        dive = np.where(cycle < self.dives, dive, 0.0)
        down = under & (dive < self.leg)
        up = under & (dive >= self.leg)
        rate = self.speed * np.sin(np.radians(self.pitch))
        depth = np.where(down, rate * dive, np.where(up, rate * (2 * self.leg - dive), 0.0))
        through = (cycle * 2.0 * self.leg + dive) * self.speed * np.cos(np.radians(self.pitch))
        azimuth = np.radians(self.heading)
        return {
            "depth": depth,
            "pitch": np.where(down, -self.pitch, np.where(up, self.pitch, 0.0)),
            "pump": np.where(down, -230.0, 230.0),
            "heading": np.full(len(time), self.heading),
            "north": through * np.cos(azimuth) + self.north * since,
            "east": through * np.sin(azimuth) + self.east * since,
            "under": under.astype(float),
            "dive": cycle,
        }

    def dive_times(self, dive: int) -> tuple[float, float]:
        """Unix times at which a dive begins and ends."""
        start = START + dive * self.cycle + self.surface
        return start, start + 2.0 * self.leg

    def position(self, time: Array) -> tuple[Array, Array]:
        state = self.state(np.asarray(time, float))
        return from_tangent_plane(state["north"], state["east"], LATITUDE, LONGITUDE)

    def displacement(self, start: float, end: float) -> tuple[float, float]:
        state = self.state(np.array([start, end]))
        return float(np.diff(state["north"])[0]), float(np.diff(state["east"])[0])


def write_csv(
    path: Path, columns: Mapping[str, Sequence[Any] | Array], delimiter: str = ","
) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file, delimiter=delimiter)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(
                ""
                if isinstance(v, float) and np.isnan(v)
                else (repr(float(v)) if isinstance(v, float) else v)
                for v in row
            )
    return path


def slocum_columns(flight: Flight) -> dict[str, Array]:
    """A Slocum's flight table in native units."""
    time, state = flight.time, flight.state(flight.time)
    return {
        "time": time,
        "m_depth": state["depth"],
        "m_pressure": state["depth"] * 1.0065 / 10.0,
        "m_pitch": np.radians(state["pitch"]),
        "m_roll": np.full(len(time), 0.02),
        "m_heading": np.radians(np.mod(state["heading"] - flight.variation, 360.0)),
        "m_battpos": np.where(state["pitch"] < 0, 0.4, -0.4),
        "m_ballast_pumped": state["pump"],
        "m_fin": np.full(len(time), 0.1),
    }


def gps_columns(flight: Flight) -> dict[str, Array]:
    """A Slocum's GPS table: fixes while at the surface."""
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
    folder: Path, flight: Flight, name: str = "unit1", **changes: Array | None
) -> list[Path]:
    """Flight and GPS tables; `changes` replaces columns of the flight table, None removes one."""
    columns = {**slocum_columns(flight), **changes}
    kept = {key: value for key, value in columns.items() if value is not None}
    return [
        write_csv(folder / f"{name}_flight.csv", kept),
        write_csv(folder / f"{name}_gps.csv", gps_columns(flight)),
    ]


def write_seaglider(folder: Path, flight: Flight, name: str = "SG999") -> list[Path]:
    """Tables of samples and dives; samples under water only."""
    times, dives = [], []
    for dive in range(flight.dives):
        start, end = flight.dive_times(dive)
        times.append(np.arange(start + 5.0, end, 10.0))
        before, after = start - 40.0, end + 60.0
        early = start - flight.surface + 100.0
        places = [flight.position(np.array([t])) for t in (early, before, after)]
        row: dict[str, Any] = {"glider": name, "dive": dive + 1}
        for fix, when, place in zip(
            ("gps1", "gps2", "gpsE"), (early, before, after), places, strict=True
        ):
            row |= {
                f"{fix}_time": when,
                f"{fix}_lat": float(place[0][0]),
                f"{fix}_lon": float(place[1][0]),
            }
        row |= {
            "magnetic_variation": flight.variation,
            "depth_avg_curr_north": flight.north,
            "depth_avg_curr_east": flight.east,
            "log_C_PITCH": 2000.0,
            "log_PITCH_CNV": 0.003,
        }
        dives.append(row)
    time = np.concatenate(times)
    state = flight.state(time)
    samples = {
        "glider": [name] * len(time),
        "dive": state["dive"] + 1,
        "time": time,
        "depth_m": state["depth"],
        "pressure_dbar": state["depth"] * 1.0085,
        "pitch_deg": state["pitch"],
        "roll_deg": np.zeros(len(time)),
        "head_mag_deg": np.mod(state["heading"] - flight.variation, 360.0),
        "vbd_cc": state["pump"],
        "gc_pitch_ctl_cm": np.where(state["pitch"] < 0, -0.6, 0.6),
        "gc_pitch_ad": np.where(state["pitch"] < 0, 1800.0, 2200.0),
        "temp_c": np.full(len(time), 8.0),
        "sal_psu": np.full(len(time), 34.0),
    }
    table = {key: [row[key] for row in dives] for key in dives[0]}
    return [
        write_csv(folder / f"{name.lower()}_samples.csv", samples),
        write_csv(folder / f"{name.lower()}_dives.csv", table),
    ]


def nmea(degrees: Array) -> Array:
    """ddmm.mmm of decimal degrees."""
    whole = np.trunc(degrees)
    return whole * 100.0 + (degrees - whole) * 60.0


def write_seaexplorer(path: Path, flight: Flight, delimiter: str = ",") -> Path:
    """A navigation log: rows every 10 s, position held under water."""
    from datetime import UTC, datetime

    time = np.arange(START, flight.time[-1], 10.0)
    state = flight.state(time)
    under = state["under"] > 0.0
    latitude, longitude = flight.position(time)
    last = np.maximum.accumulate(np.where(under, 0, np.arange(len(time))))
    return write_csv(
        path,
        {
            "Timestamp": [
                datetime.fromtimestamp(t, UTC).strftime("%d/%m/%Y %H:%M:%S") for t in time
            ],
            "NavState": np.where(under, np.where(state["pitch"] < 0, 100, 117), 116),
            "Heading": np.mod(state["heading"] - flight.variation, 360.0),
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


def write_mat(path: Path, flight: Flight) -> Path:
    """An LRAUV log: HDF5 groups of time (MATLAB days), value, units; every sample twice."""
    import netCDF4

    time = flight.time[::5]
    state = flight.state(time)
    surfaced = state["under"] == 0.0
    latitude, longitude = flight.position(time)
    signals = {
        "depth": (time, state["depth"], "m"),
        "latitude_fix": (time[surfaced], latitude[surfaced], "arcdeg"),
        "longitude_fix": (time[surfaced] + 0.001, longitude[surfaced], "arcdeg"),
        "sea_water_temperature": (time, np.full(len(time), 283.15), "K"),
    }
    with netCDF4.Dataset(path, "w") as file:
        for name, (at, values, unit) in signals.items():
            group = file.createGroup(name)
            group.createDimension("one", 1)
            group.createDimension("n", 2 * len(at))
            group.createDimension("u", len(unit))
            group.createVariable("time", "f8", ("n", "one"))[:, 0] = np.repeat(
                at / 86400.0 + 719529.0, 2
            )
            group.createVariable("value", "f8", ("n", "one"))[:, 0] = np.repeat(values, 2)
            group.createVariable("units", "u2", ("u", "one"))[:, 0] = [ord(c) for c in unit]
    return path


def write_nc4(path: Path, flight: Flight) -> Path:
    """An LRAUV log as netCDF-4: each variable with a time of its own."""
    import netCDF4

    time = flight.time
    state = flight.state(time)
    signals = {
        "depth": (state["depth"], "m"),
        "platform_pitch_angle": (np.radians(state["pitch"]), "rad"),
        "platform_buoyancy_position": (state["pump"] * 1e-6, "m3"),
    }
    with netCDF4.Dataset(path, "w") as file:
        for name, (values, unit) in signals.items():
            file.createDimension(f"{name}_time", len(time))
            clock = file.createVariable(f"{name}_time", "f8", (f"{name}_time",))
            clock.units = "seconds since 1970-01-01T00:00:00Z"
            clock[:] = time
            variable = file.createVariable(name, "f8", (f"{name}_time",))
            variable.units = unit
            variable[:] = values
    return path
