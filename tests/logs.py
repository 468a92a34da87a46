"""Logs of an imaginary glider in the layouts of real ones, written by the tests of the import."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from factory.importing import import_logs
from twin.errors import InputError
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


def part(columns: dict[str, Array], rows: Any) -> dict[str, Array]:
    """Some rows of columns."""
    return {name: values[rows] for name, values in columns.items()}


def write_slocum(
    folder: Path,
    flight: Flight,
    name: str = "unit1",
    rows: Any = slice(None),
    gps: dict[str, Array] | None = None,
    **changes: Array | None,
) -> list[Path]:
    """Flight and GPS tables; `changes` replaces columns of the flight table, None removes one.

    Of the flight table `rows` are written; `gps` stands instead of the flight's own fixes.
    """
    columns = {**slocum_columns(flight), **changes}
    kept = {key: value for key, value in columns.items() if value is not None}
    return [
        write_csv(folder / f"{name}_flight.csv", part(kept, rows)),
        write_csv(folder / f"{name}_gps.csv", gps or gps_columns(flight)),
    ]


def slocum(folder: Path, flight: Flight, name: str = "unit1", **written: Any) -> Any:
    """What the import makes of the tables of `write_slocum`: dataset and report."""
    return import_logs("slocum", write_slocum(folder, flight, name, **written))


def refused(match: str, *args: Any, by: Callable[..., Any] = import_logs, **options: Any) -> None:
    """Call what shall raise an InputError of one line that matches."""
    with pytest.raises(InputError, match=match) as caught:
        by(*args, **options)
    assert "\n" not in str(caught.value)


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


def table_columns(flight: Flight) -> dict[str, Array]:
    """A table as the mapping of docs/howto/import_tables.md reads: forward-left-up, from east."""
    time, state = flight.time, flight.state(flight.time)
    under = state["under"] > 0.0
    latitude, longitude = flight.position(time)
    return {
        "stamp": (time - START) * 1e3,
        "z": state["depth"] * 100.0,
        "theta": -np.radians(state["pitch"]),
        "yaw": np.radians(90.0 - state["heading"]),
        "r": np.full(len(time), -0.5),
        "vx": np.where(under, state.get("speed", flight.speed) / 0.514444, -99.0),
        "engine": state["pump"] / 1000.0,
        "lat": np.where(under, np.nan, latitude),
        "lon": np.where(under, np.nan, longitude),
        "ax": np.zeros(len(time)),
        "comment": np.zeros(len(time)),
    }


def write_table(folder: Path, flight: Flight, page: str) -> list[Path]:
    """A table and the mapping of the page, which reads it."""
    (folder / "mine.toml").write_text(example(page, "mine.toml"))
    return [write_csv(folder / "log.csv", table_columns(flight))]


SENTINEL = 25.032015
"""[m/s] What a Sailfish's DVL writes without lock."""


def sailfish_columns(seconds: float = 400.0) -> dict[str, Array]:
    """A run of circles and straight legs at 1.5 m/s; the vehicle slips outwards in turns."""
    time = np.arange(0.0, seconds, 0.1)
    turning = (time % 100.0) < 50.0
    rate = np.where(turning, 0.08, 0.0)  # [rad/s] to starboard
    heading = np.cumsum(rate) * 0.1
    surge, sway = np.full(len(time), 1.5), -2.0 * rate
    north = np.cumsum(surge * np.cos(heading) - sway * np.sin(heading)) * 0.1
    east = np.cumsum(surge * np.sin(heading) + sway * np.cos(heading)) * 0.1
    latitude, longitude = from_tangent_plane(north, east, 34.5, 108.4)
    nothing = np.zeros(len(time))
    lost = (time % 40.0) < 10.0
    return {
        "lat": latitude, "lon": longitude, "alt": nothing,
        "roll": nothing + 0.02, "pitch": nothing + 0.1,
        "yaw": np.angle(np.exp(1j * (0.5 * np.pi - heading))),
        "vn": nothing, "ve": nothing,
        "vf": np.where(lost, -SENTINEL, surge), "vl": np.where(lost, SENTINEL, -sway),
        "vu": nothing, "ax": np.gradient(surge, 0.1), "ay": nothing, "az": nothing,
        "wx": nothing, "wy": nothing + 0.01, "wz": -rate, "wf": nothing, "numsats": nothing,
        "time": time,
    }  # fmt: skip


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


def write_og1(path: Path, flight: Flight) -> Path:
    """An OG1.0 file: radian, minutes since 1970, a heading that says that it is magnetic."""
    import netCDF4

    time = flight.time
    state = flight.state(time)
    under = state["under"] > 0
    latitude, longitude = flight.position(time)
    minutes = {"units": "minutes since 1970-01-01"}
    magnetic = {"long_name": "magnetic heading", "units": "degree"}
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("N_MEASUREMENTS", len(time))
        for name, values, attributes in (
            ("TIME", time / 60.0, minutes),
            ("DEPTH", state["depth"], {"units": "m"}),
            ("PITCH", np.radians(state["pitch"]), {"units": "rad"}),
            ("HEADING", state["heading"] - flight.variation, magnetic),
            ("LATITUDE_GPS", np.where(under, np.nan, latitude), {}),
            ("LONGITUDE_GPS", np.where(under, np.nan, longitude), {}),
            ("TIME_GPS", np.where(under, np.nan, time / 60.0), minutes),
        ):
            variable = file.createVariable(name, "f8", ("N_MEASUREMENTS",))
            variable.setncatts(attributes)
            variable[:] = values
    return path


def write_ngdac(folder: Path, flight: Flight) -> list[Path]:
    """IOOS NGDAC files, one for each descent and climb: CF names, seconds since 1990."""
    import netCDF4

    time = flight.time
    state = flight.state(time)
    latitude, longitude = flight.position(time)
    zero = 631152000.0
    paths = []
    for dive in range(flight.dives):
        start, end = flight.dive_times(dive)
        middle = start + flight.leg
        for first, last in ((start - 60.0, middle), (middle, end + 60.0)):
            inside = (time >= first) & (time < last)
            series = {
                "time": (time[inside] - zero, "seconds since 1990-01-01T00:00:00Z"),
                "depth": (state["depth"][inside], "m"),
                "pressure": (1.0065 * state["depth"][inside], "dbar"),
                "temperature": (np.full(inside.sum(), 8.0), "Celsius"),
                "salinity": (np.full(inside.sum(), 34.0), "1"),
                "lat": (latitude[inside], "degrees_north"),
                "lon": (longitude[inside], "degrees_east"),
                "pitch": (state["pitch"][inside], "degrees"),
                "heading": (state["heading"][inside], "degrees"),
            }
            scalars = {
                "profile_id": 2.0 * dive + (first == middle),
                "profile_time": 0.5 * (first + last) - zero,
                "profile_lat": latitude[inside].mean(),
                "profile_lon": longitude[inside].mean(),
                "u": flight.east,
                "v": flight.north,
                "time_uv": 0.5 * (start + end) - zero,
                "lat_uv": latitude[inside].mean(),
                "lon_uv": longitude[inside].mean(),
            }
            path = folder / f"glider_{int(first)}_rt.nc"
            with netCDF4.Dataset(path, "w") as file:
                file.createDimension("time", int(inside.sum()))
                file.createDimension("letters", 7)
                file.createVariable("trajectory", "S1", ("letters",))[:] = list("unit-23")
                for name, (values, units) in series.items():
                    file.createVariable(name, "f8", ("time",))[:] = values
                    file[name].units = units
                file.createVariable("depth_qc", "i1", ("time",))[:] = 1
                for name, value in scalars.items():
                    file.createVariable(name, "f8", ())[...] = value
                file["time_uv"].units = "seconds since 1990-01-01T00:00:00Z"
            paths.append(path)
    return paths


def write_pyglider(
    path: Path, flight: Flight, *, pump: bool = True, reckoned: bool = False
) -> Path:
    """A time series of pyglider: a SeaExplorer's, positions on lines between the fixes; or a
    Slocum's in radian, whose positions it reckoned, meandering and 20 m off at the end."""
    import netCDF4

    time = flight.time
    state = flight.state(time)
    at_surface = state["under"] == 0.0
    latitude, longitude = flight.position(time)
    if reckoned:
        wrong = np.where(at_surface, 0.0, (time - START) % flight.cycle - flight.surface)
        minute = np.arange(time[0], time[-1] + 60.0, 60.0)  # it logs a position once a minute
        meander = np.where(at_surface, 0.0, np.interp(time, minute, 5.0 * np.sin(minute)))
        latitude = latitude + (wrong / (2.0 * flight.leg) * 20.0 + meander) / 111e3
    else:
        latitude, longitude = (
            np.interp(time, time[at_surface], values[at_surface])
            for values in (latitude, longitude)
        )
    angle = np.radians if reckoned else np.asarray
    series = {
        "time": (time, "seconds since 1970-01-01T00:00:00Z", "time"),
        "latitude": (latitude, "degrees_north", "m_lat" if reckoned else "NAV_LATITUDE"),
        "longitude": (longitude, "degrees_east", "m_lon" if reckoned else "NAV_LONGITUDE"),
        "depth": (state["depth"], "m", ""),
        "pressure": (1.0065 * state["depth"], "dbar", "GPCTD_PRESSURE"),
        "temperature": (np.full(len(time), 8.0), "Celsius", "GPCTD_TEMPERATURE"),
        "salinity": (np.full(len(time), 34.0), "1", ""),
        "pitch": (angle(state["pitch"]), "degrees", "m_pitch" if reckoned else "Pitch"),
        "roll": (angle(np.full(len(time), 1.0)), "degrees", "m_roll" if reckoned else "Roll"),
        "heading": (
            angle(np.mod(state["heading"] - flight.variation, 360.0)), "degrees",
            "m_heading" if reckoned else "Heading",
        ),
        "ballast": (state["pump"], "cm3", "m_ballast_pumped" if reckoned else "BallastPos"),
        "profile_index": (2.0 * state["dive"] + (state["pitch"] > 0.0), "1", ""),
        "profile_direction": (-np.sign(state["pitch"]), "1", ""),
        "distance_over_ground": (np.zeros(len(time)), "km", ""),
    }  # fmt: skip
    if not pump:
        del series["ballast"]
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", len(time))
        file.glider_model = "Slocum" if reckoned else "SeaExplorer"
        for name, (values, units, source) in series.items():
            variable = file.createVariable(name, "f8", ("time",))
            variable.setncatts({"units": units, **({"source": source} if source else {})})
            variable[:] = values
    return path


def write_basestation(folder: Path, flight: Flight, number: int = 999) -> list[Path]:
    """A Seaglider's basestation files, one a dive: samples under water, actuators after moves."""
    import netCDF4

    paths = []
    for dive in range(flight.dives):
        start, end = flight.dive_times(dive)
        time = np.arange(start + 5.0, end, 10.0)
        state = flight.state(time)
        fixes = np.array([start - flight.surface + 100.0, start - 40.0, end + 60.0])
        latitude, longitude = flight.position(fixes)
        turned = start + flight.leg  # the bladder and the battery move once, at the bottom
        series = {
            "time": time,
            "pressure": state["depth"] * 1.0085,
            "depth": state["depth"],
            "eng_pitchAng": state["pitch"],
            "eng_rollAng": np.zeros(len(time)),
            "eng_head": np.mod(state["heading"] - flight.variation, 360.0),
            "eng_vbdCC": state["pump"],
        }
        moves = {
            "gc_end_secs": np.array([start, turned]),
            "gc_pitch_ctl": np.array([-0.6, 0.6]),
            "gc_vbd_ctl": np.array([-230.0, 230.0]),
            "gc_pitch_ad": np.array([1800.0, 2200.0]),
            "gc_roll_ad": np.array([2000.0, 2000.0]),
        }
        gps = {"log_gps_time": fixes, "log_gps_lat": latitude, "log_gps_lon": longitude}
        water = {"ctd_time": time + 1.0, "temperature": 8.0, "salinity": 34.0}
        numbers = {
            "magnetic_variation": flight.variation,
            "depth_avg_curr_north": flight.north,
            "depth_avg_curr_east": flight.east,
            "log_C_PITCH": 2000.0,
            "log_PITCH_CNV": 0.003,
            "log_C_ROLL_DIVE": 2000.0,
            "log_C_ROLL_CLIMB": 2000.0,
            "log_ROLL_CNV": 0.028,
        }
        path = folder / f"p{number:03d}{dive + 1:04d}.nc"
        with netCDF4.Dataset(path, "w") as file:
            file.setncatts({"platform_id": f"SG{number}", "dive_number": dive + 1})
            for dimension, size, columns in (
                ("sg_data_point", len(time), series),
                ("ctd_data_point", len(time), water),
                ("gc_event", 2, moves),
                ("gps_info", 3, gps),
            ):
                file.createDimension(dimension, size)
                for name, values in columns.items():
                    file.createVariable(name, "f8", (dimension,))[:] = values
            for name, value in numbers.items():
                file.createVariable(name, "f8", ())[...] = value
            target = "4936.000,-5800.000"
            file.createDimension("letters", len(target))
            file.createVariable("log_TGT_LATLONG", "S1", ("letters",))[:] = list(target)
        paths.append(path)
    return paths


def write_spray(path: Path, flight: Flight, missions: Sequence[int] = (7,)) -> Path:
    """A Spray's binned file: of each dive its middle, and a profile of its climb in bins of 10 m.

    As spraydata.ucsd.edu publishes them: (depth, profile), places and times of both middles.
    """
    import netCDF4

    bins = np.arange(10.0, flight.depth + 20.0, 10.0)
    year = 366.0 * 86400.0
    rows: list[list[float]] = []
    for number, mission in enumerate(missions):
        for dive in range(flight.dives):
            start, end = flight.dive_times(dive)
            fixes = np.array([start, end])
            latitude, longitude = flight.position(fixes)
            middle = [0.5 * (v[0] + v[1]) for v in (fixes + year * number, latitude, longitude)]
            profile = [
                0.25 * v[0] + 0.75 * v[1] for v in (fixes + year * number, latitude, longitude)
            ]
            rows.append([*profile, *middle, flight.east, flight.north, float(mission)])
    names = (
        "time", "lat", "lon", "time_uv", "lat_uv", "lon_uv", "u_depth_mean", "v_depth_mean",
        "mission",
    )  # fmt: skip
    reached = bins <= flight.depth
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("depth", len(bins))
        file.createDimension("profile", len(rows))
        file.createVariable("depth", "f8", ("depth",))[:] = bins
        for name, column in zip(names, zip(*rows, strict=True), strict=True):
            file.createVariable(name, "f8", ("profile",))[:] = column
            if name.startswith("time"):
                file[name].units = "seconds since 1970-01-01T00:00:00Z"
        for name, values in (("temperature", 15.0 - 0.02 * bins), ("salinity", 33.0 + 0.0 * bins)):
            column = np.where(reached, values, np.nan)
            grid = file.createVariable(name, "f8", ("depth", "profile"))
            grid[:] = np.repeat(column[:, None], len(rows), axis=1)
    return path


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
    """A Slocum's binary flight log and its cache file: sensors in native units, GPS among them.

    `columns` replaces them all, time first: a science log (.ebd). A log that is not `factored`
    lists its sensors itself, behind its header.

    The format: 14 lines of text, the tag `s` with numbers that show the byte order, then for each
    cycle the tag `d`, two bits a sensor (0 nothing, 1 as before, 2 new) and the new values.
    """
    import struct

    gps = gps_columns(flight)
    ending = "dbd" if columns is None else "ebd"
    flown = slocum_columns(flight)
    names = dict(columns) if columns is not None else {
        "m_present_time": flown.pop("time"),
        **flown,
        "m_gps_lat": nmea(gps["lat"]),
        "m_gps_lon": nmea(gps["lon"]),
        "m_gps_status": gps["status"],
        "m_gps_mag_var": gps["mag_var_rad"],
    }  # fmt: skip
    names = {name: values for name, values in names.items() if name not in without}
    size = 8
    listing = [f"s: T {k} {k} {size} {name} nodim" for k, name in enumerate(names)]
    cache = folder / f"{crc}.cac"
    cache.write_text("\n".join(listing) + "\n")
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
        values = [
            None if (name.startswith("m_gps") and fix is None) else
            float(column[fix if name.startswith("m_gps") else row])
            for name, column in names.items()
        ]  # fmt: skip
        states = bytearray(state_bytes)
        for k, value in enumerate(values):
            if value is not None:
                states[k // 4] |= 2 << (6 - 2 * (k % 4))
        data += b"d" + states + b"".join(struct.pack("<d", v) for v in values if v is not None)
    path = folder / f"{vehicle}-2023-317-0-0.{ending}"
    path.write_bytes(bytes(data) + b"X")
    return [path, cache]


def pack(content: bytes, block: int = 32 * 1024) -> bytes:
    """A Slocum's compressed file: blocks of lz4 behind their lengths, big-endian."""
    import lz4.block

    packed = bytearray()
    for start in range(0, len(content), block):
        piece = lz4.block.compress(content[start : start + block], store_size=False)
        packed += len(piece).to_bytes(2, "big") + piece
    return bytes(packed)


def example(page: str, name: str) -> str:
    """The program of a page's indented block that begins with the comment `# name`."""
    block = page.split(f"    # {name}\n")[1]
    lines = []
    for line in block.splitlines():
        if line.strip() and not line.startswith("    "):
            break
        lines.append(line[4:])
    return "\n".join(lines)
