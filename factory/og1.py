"""OG1: one mission as an OceanGliders 1.0 trajectory file (netCDF-4), plainly marked as simulated.

Format: OceanGliders OG1.0 terms of reference, version 1.0.0 (2024), on CF-1.10 and ACDD-1.3. The
format knows one file per deployment, so each mission is one. LATITUDE and LONGITUDE are what the
glider itself logged, its on-board dead-reckoned track; the truth, which no real file has, is in
variables named TRUE_*. Simulated missions have no date: TIME counts from a nominal deployment.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from factory.stored import StoredRun
from twin.current.origin import Origin
from twin.errors import StoreError
from twin.schema import VARIABLES
from twin.version import __version__

Array = NDArray[np.float64]

N_MEASUREMENTS = "N_MEASUREMENTS"
EPOCH = "seconds since 1970-01-01T00:00:00Z"
NOMINAL_DEPLOYMENT = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
"""Every mission's start: OG1.0 needs a date after 2001-09-09 (valid_min 1e9 s)."""
FILL = -9999.9
"""Of positions and depth, as the format prescribes"""
TIME_FILL = -1.0
ROLES = "https://vocab.nerc.ac.uk/collection/W08/current/"
PLATFORM = "https://vocab.nerc.ac.uk/collection/L06/current/27/"
VOCABULARY = "https://vocab.nerc.ac.uk/collection/OG1/current/"
PHASES = (
    "https://github.com/OceanGlidersCommunity/OG-format-user-manual/blob/main/"
    "vocabularyCollection/phase.md"
)
COORDINATES = "TIME LONGITUDE LATITUDE DEPTH"
ASCENT, DESCENT, SURFACING, INFLECTION = 1, 2, 3, 5
"""Codes of the format's phase vocabulary"""
SURFACE_DEPTH_M = 1.5
"""Shallower the glider counts as at the surface: half a hull and some"""
STILL_SPEED = 0.03
"""[m/s] vertical: slower under water it is turning"""

MEASURED = (
    ("PRES", "measured_pressure", "SENSOR_PRESSURE"),
    ("PITCH", "measured_pitch", "SENSOR_AHRS"),
    ("ROLL", "measured_roll", "SENSOR_AHRS"),
    ("HEADING", "measured_heading", "SENSOR_AHRS"),
    ("ROLL_RATE", "measured_roll_rate", "SENSOR_AHRS"),
    ("PITCH_RATE", "measured_pitch_rate", "SENSOR_AHRS"),
    ("YAW_RATE", "measured_yaw_rate", "SENSOR_AHRS"),
    ("SPECIFIC_FORCE_X", "measured_specific_force_x", "SENSOR_AHRS"),
    ("SPECIFIC_FORCE_Y", "measured_specific_force_y", "SENSOR_AHRS"),
    ("SPECIFIC_FORCE_Z", "measured_specific_force_z", "SENSOR_AHRS"),
    ("BATTERY_SHIFT", "measured_shift", ""),
    ("BATTERY_ROTATION", "measured_rotation", ""),
    ("PUMPED_VOLUME", "measured_pump", ""),
    ("DVL_SURGE", "measured_dvl_surge", "SENSOR_DVL"),
    ("DVL_SWAY", "measured_dvl_sway", "SENSOR_DVL"),
    ("DVL_HEAVE", "measured_dvl_heave", "SENSOR_DVL"),
)
"""(name in the file, name in the store, sensor variable)"""
SENSORS = {
    "SENSOR_PRESSURE": (
        "simulated pressure transducer", "https://vocab.nerc.ac.uk/collection/L05/current/",
    ),
    "SENSOR_AHRS": (
        "simulated Microstrain 3DM-GX5-25 attitude and heading reference",
        "https://vocab.nerc.ac.uk/collection/L05/current/",
    ),
    "SENSOR_DVL": (
        "simulated LinkQuest 600 kHz micro DVL",
        "https://vocab.nerc.ac.uk/collection/L05/current/",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Series:
    """One variable of the file."""

    values: NDArray[Any]
    attributes: Mapping[str, Any]
    fill: float | int | None = None
    dimensions: tuple[str, ...] = (N_MEASUREMENTS,)
    kind: str = field(default="f8")


def export_og1(run: StoredRun, mission: int, folder: Path) -> Path:
    """Write one mission into `folder`, under the name that the format prescribes.

    Raises:
      StoreError: no such mission, or its data cannot be read.
    """
    run.check_mission(mission)
    missing = [name for name in _needed() if name not in run.dataset]
    if missing:
        raise StoreError(f"store {run.path} lacks {', '.join(missing)}: OG1.0 needs them")
    identity = _identity(run, mission)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{identity['id']}.nc"
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        file.setncatts(identity)
        file.createDimension(N_MEASUREMENTS, int(run.samples[mission]))
        for name, series in _series(run, mission, identity):
            options: dict[str, Any] = {"compression": "zlib"} if series.dimensions else {}
            kind: Any = str if series.kind == "str" else series.kind
            variable: Any = file.createVariable(
                name, kind, series.dimensions, fill_value=series.fill, **options
            )
            variable.setncatts(dict(series.attributes))
            if series.kind == "str":
                variable[...] = str(series.values)
            else:
                values = np.asarray(series.values, series.kind)
                if series.fill is not None:
                    values = np.where(np.isnan(values), series.fill, values)
                variable[...] = values
    return path


def _needed() -> list[str]:
    positions = ["measured_onboard_north", "measured_onboard_east", "measured_gps_north"]
    return [*positions, "measured_gps_east", "measured_depth", *(name for _, name, _ in MEASURED)]


def _stamp(moment: datetime.datetime) -> str:
    return moment.strftime("%Y%m%dT%H%M%S")


def _identity(run: StoredRun, mission: int) -> dict[str, Any]:
    """Global attributes."""
    serial = f"sim{mission:06d}"
    start = _stamp(NOMINAL_DEPLOYMENT)
    end = NOMINAL_DEPLOYMENT + datetime.timedelta(seconds=float(run.small("duration")[mission]))
    preset, seed = run.settings["preset"], run.seed
    return {
        "title": "SIMULATED OceanGliders trajectory file",
        "summary": "Simulated underwater glider mission: not an observation of the ocean.",
        "platform": "sub-surface gliders",
        "platform_vocabulary": PLATFORM,
        "id": f"{serial}_{start}_delayed",
        "naming_authority": "glider-twin",
        "institution": "none: simulation",
        "internal_mission_identifier": f"{preset}_seed{seed}_mission{mission}",
        "time_coverage_start": start,
        "time_coverage_end": _stamp(end),
        "contributor_name": "glider-twin simulation",
        "contributor_email": "n/a",
        "contributor_role": "originator",
        "contributor_role_vocabulary": ROLES,
        "contributing_institutions": "none: simulation",
        "contributing_institutions_role": "Operator",
        "contributing_institutions_role_vocabulary": ROLES,
        "rtqc_method": "No QC applied",
        "rtqc_method_doi": "n/a",
        "comment": f"SIMULATED DATA. Preset {preset}, seed {seed}, mission {mission}, split "
        f"{run.splits[mission]}; the date is nominal. LATITUDE and LONGITUDE are the simulated "
        "on-board dead reckoning, TRUE_* variables what really happened in the simulation.",
        "source": f"simulation: glider-twin {__version__}, vehicle {run.settings['vehicle']}",
        "history": str(run.dataset.attrs["history"]),
        "references": "https://oceangliderscommunity.github.io/OG-format-user-manual/OG_Format.html",
        "start_date": start,
        "date_created": _stamp(datetime.datetime.now(datetime.UTC)),
        "featureType": "trajectory",
        "Conventions": "CF-1.10, ACDD-1.3, OG-1.0",
    }


def _series(
    run: StoredRun, mission: int, identity: Mapping[str, Any]
) -> Iterator[tuple[str, Series]]:
    samples = int(run.samples[mission])

    def row(name: str) -> Array:
        return run.row(name, mission)[:samples].astype(float)

    origin = Origin(latitude_deg=run.parameters(mission).number("water.latitude"))
    start = NOMINAL_DEPLOYMENT.timestamp()
    time = start + np.arange(samples) * float(run.settings["sample_period_s"])
    depth = np.maximum(row("measured_depth"), 0.0)  # valid_min is 0: the gauge's zero error
    yield (
        "TRAJECTORY",
        _text(
            str(identity["id"]).removesuffix("_delayed"), "trajectory name", cf_role="trajectory_id"
        ),
    )
    yield "WMO_IDENTIFIER", _text("none: simulation", "wmo id")
    model = {"platform_model_vocabulary": "n/a"}
    vehicle = str(run.settings["vehicle"])
    yield "PLATFORM_MODEL", _text(f"simulated {vehicle} glider", "model of the glider", **model)
    yield "PLATFORM_SERIAL_NUMBER", _text(f"sim{mission:06d}", "glider serial number")
    yield "TIME", Series(time, _time_attributes("Time elapsed since 1970-01-01T00:00:00Z"))
    latitude, longitude = geographic(
        row("measured_onboard_north"), row("measured_onboard_east"), origin
    )
    method = {"interpolation_methodology": "simulated on-board dead reckoning between GPS fixes"}
    long_name = "longitude of each measurement and GPS location"
    yield "LONGITUDE", _position(longitude, long_name, "longitude", method)
    yield "LATITUDE", _position(latitude, "Latitude north (WGS84)", "latitude", method)
    yield (
        "DEPTH",
        Series(
            depth,
            {
                "long_name": "depth below the surface by the simulated pressure transducer",
                "standard_name": "depth",
                "units": "m",
                "positive": "down",
                "axis": "Z",
                "valid_min": 0.0,
                "valid_max": 10000.0,
                "depth_vocabulary": VOCABULARY + "DEPTH/",
            },
            fill=FILL,
        ),
    )
    gps_latitude, gps_longitude = geographic(
        row("measured_gps_north"), row("measured_gps_east"), origin
    )
    fixed = np.isfinite(gps_latitude)
    gps_time = np.where(fixed, time, np.nan)
    yield "TIME_GPS", Series(gps_time, _time_attributes("time of each GPS location"), TIME_FILL)
    at = {"coordinates": COORDINATES}
    yield (
        "LONGITUDE_GPS",
        _position(gps_longitude, "longitude of each GPS location", "longitude", at),
    )
    yield "LATITUDE_GPS", _position(gps_latitude, "latitude of each GPS location", "latitude", at)
    yield (
        "DEPLOYMENT_TIME",
        Series(np.array(start), _time_attributes("date of deployment"), dimensions=()),
    )
    for name, value in (
        ("DEPLOYMENT_LATITUDE", origin.latitude_deg),
        ("DEPLOYMENT_LONGITUDE", origin.longitude_deg),
    ):
        kind = name.removeprefix("DEPLOYMENT_").lower()
        attributes = {
            "long_name": f"{kind} of deployment",
            "standard_name": kind,
            "units": "degrees_north" if kind == "latitude" else "degrees_east",
        }
        yield name, Series(np.array(value), attributes, dimensions=())
    yield (
        "PHASE",
        Series(
            phases(depth, row("true_velocity_down")),
            {
                "long_name": "behavior of the glider at sea",
                "phase_vocabulary": PHASES,
                "phase_calculation_method": "depth and vertical speed of the simulation",
                "coordinates": COORDINATES,
            },
            fill=0,
            kind="i1",
        ),
    )
    for name, (model_name, vocabulary) in SENSORS.items():
        yield (
            name,
            Series(
                np.array(0, np.int8),
                {
                    "long_name": model_name,
                    "sensor_model": model_name,
                    "sensor_model_vocabulary": "n/a",
                    "sensor_type_vocabulary": vocabulary,
                    "comment": "simulated",
                },
                dimensions=(),
                kind="i1",
            ),
        )
    for name, stored, sensor in MEASURED:
        yield name, _signal(row(stored), stored, {"sensor": sensor} if sensor else {})
    true_latitude, true_longitude = geographic(row("true_north"), row("true_east"), origin)
    yield "TRUE_LONGITUDE", _position(true_longitude, "true longitude", "longitude", at)
    yield "TRUE_LATITUDE", _position(true_latitude, "true latitude", "latitude", at)
    for stored in run.signals():
        if stored.startswith("true_"):
            yield stored.upper(), _signal(row(stored), stored, {})


def geographic(north: Array, east: Array, origin: Origin) -> tuple[Array, Array]:
    """Latitude and longitude [deg] of points [m] on the tangent plane at `origin`, to second order.

    See `Origin.curvature`; the error is below 1 m within 28 km.
    """
    latitude = north - 0.5 * origin.curvature * east**2
    longitude = east * (1.0 + north * origin.curvature)
    cosine = np.cos(np.radians(origin.latitude_deg))
    return (
        origin.latitude_deg + np.degrees(latitude / origin.meridian_radius),
        origin.longitude_deg + np.degrees(longitude / (origin.normal_radius * cosine)),
    )


def phases(depth: Array, velocity_down: Array) -> NDArray[np.int8]:
    """OG1.0 phase of each sample from depth [m] and vertical speed [m/s]."""
    phase = np.where(velocity_down > 0.0, DESCENT, ASCENT)
    phase = np.where(np.abs(velocity_down) < STILL_SPEED, INFLECTION, phase)
    return np.where(depth < SURFACE_DEPTH_M, SURFACING, phase).astype(np.int8)


def _text(value: str, long_name: str, **attributes: str) -> Series:
    return Series(
        np.array(value), {"long_name": long_name, **attributes}, dimensions=(), kind="str"
    )


def _time_attributes(long_name: str) -> dict[str, Any]:
    return {
        "long_name": long_name,
        "standard_name": "time",
        "units": EPOCH,
        "calendar": "gregorian",
        "valid_min": 1e9,
        "valid_max": 4e9,
    }


def _position(
    values: Array, long_name: str, standard_name: str, attributes: Mapping[str, Any]
) -> Series:
    largest = 90.0 if standard_name == "latitude" else 180.0
    return Series(
        values,
        {
            "long_name": long_name,
            "standard_name": standard_name,
            "units": "degrees_north" if standard_name == "latitude" else "degrees_east",
            "valid_min": -largest,
            "valid_max": largest,
            **attributes,
        },
        fill=FILL,
    )


def _signal(values: Array, stored: str, attributes: Mapping[str, Any]) -> Series:
    variable = VARIABLES[stored]
    described: dict[str, Any] = {
        **variable.attributes(),
        "long_name": f"{variable.long_name} (simulated)",
        "coordinates": COORDINATES,
        **attributes,
    }
    return Series(values, described, fill=np.nan, kind="f4")
