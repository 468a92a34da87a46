"""Terms of OG1.0: vocabularies, names and global attributes, as simulated missions fill them."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.metadata import Metadata, with_metadata
from factory.exporting.og1.simulated import SimulatedMission
from factory.generation.generated_store import GeneratedStore, StoredFlight
from twin.bounded import file_names
from twin.records.attributes import made_at
from twin.records.logged import LogStore
from twin.records.schema import SIMULATED
from twin.records.trajectory import actuator_names
from twin.sensors import SensorSuite
from twin.version import __version__

Array = NDArray[np.float64]

N_MEASUREMENTS = "N_MEASUREMENTS"
EPOCH = "seconds since 1970-01-01T00:00:00Z"
FILL = -9999.9
"""Of positions and depth, as the format prescribes"""
TIME_FILL = -1.0
ROLES = "https://vocab.nerc.ac.uk/collection/W08/current/"
OG_FORMAT = "https://oceangliderscommunity.github.io/OG-format-user-manual/OG_Format.html"
PLATFORM = "https://vocab.nerc.ac.uk/collection/L06/current/27/"
VOCABULARY = "https://vocab.nerc.ac.uk/collection/OG1/current/"
PHASES = (
    "https://github.com/OceanGlidersCommunity/OG-format-user-manual/blob/main/"
    "vocabularyCollection/phase.md"
)
COORDINATES = "TIME LONGITUDE LATITUDE DEPTH"
ASCENT, DESCENT, SURFACING, INFLECTION = 1, 2, 3, 5
"""Codes of the format's phase vocabulary"""
PHASE_FLAGS = {
    ASCENT: "ascent",
    DESCENT: "descent",
    SURFACING: "surfacing",
    INFLECTION: "inflexion",
}
"""Those that occur here, spelt as in the vocabulary"""
DVL_MODES = {0: "none", 1: "bottom", 2: "water"}
"""What the DVL's velocity is relative to; with the bottom it contains the current"""
DVL_MODE_FILL = -1
SURFACE_DEPTH_M = 1.5
"""Shallower the glider counts as at the surface: half a hull and some"""
STILL_SPEED = 0.03
"""[m/s] vertical: slower under water it is turning"""

SIMULATED_MEASURED = (
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
"""(name in the file, name in the store, sensor variable) of simulated missions of gliders"""
CTD_MEASURED = (
    ("DENSITY", "measured_density", "SENSOR_CTD"),
    ("TEMP", "measured_temperature", "SENSOR_CTD"),
    ("PSAL", "measured_salinity", "SENSOR_CTD"),
)
"""The same of the CTD, where the water has temperature and salinity; logs have them too"""


def simulated_terms(signals: Sequence[str]) -> list[tuple[str, str, str]]:
    """The terms of a store of simulated missions, by the parts that its vehicle has.

    Args:
      signals: names of all its signals.
    """
    parts = actuator_names(signals)
    gliders = {f"measured_{name}" for name in actuator_names(SIMULATED)}
    own = {f"measured_{name}" for name in parts}
    terms = [term for term in SIMULATED_MEASURED if term[1] not in gliders - own]
    ctd = (*CTD_MEASURED, ("CNDC", "measured_conductivity", "SENSOR_CTD"))
    terms += [term for term in ctd if term[1] in signals]
    named = {stored for _, stored, _ in terms}
    return terms + [(name.upper(), name, "") for name in sorted(own - named)]


LOGGED_MEASURED = (("RUDDER", "measured_fin", ""),)
"""The same of what only real vehicles log"""
TRACKS = (
    ("measured_onboard", "{}_ONBOARD", "by the vehicle's own dead reckoning"),
    ("commanded_waypoint", "WAYPOINT_{}", "of the waypoint that the vehicle was sent to"),
    ("true", "TRUE_{}", "where the simulated vehicle really was"),
)
"""Signals `..._north` and `..._east` [m] of stores, their names as latitude and longitude"""
RAW_TIMES = {
    "measured_depth_time": "TIME_DEPTH",
    "measured_attitude_time": "TIME_ATTITUDE",
    "measured_ctd_time": "TIME_CTD",
}
"""Times of the original samples beside those of the grid"""
VARIATION = "MAGNETIC_VARIATION"
PAYLOAD = {
    "measured_oxygen": "DOXY",
    "measured_chlorophyll": "CHLA",
    "measured_dissolved_organic_matter": "CDOM",
    "measured_turbidity": "TURBIDITY",
}
"""Name in the file of what the format has names for; oxygen is per mass there."""
VELOCITY = "m s-1"
UNITS = {
    "TIME": EPOCH,
    "LATITUDE": "degrees_north",
    "LONGITUDE": "degrees_east",
    "DEPTH": "m",
    "POSITION_SD": "m",
    "DIVE_NUMBER": "1",
    VARIATION: "degree",
    "CNDC": "S m-1",
    "DOXY": "umol kg-1",
    "CHLA": "mg m-3",  # 1 ug L-1
    "CDOM": "1e-9",
    "TURBIDITY": "1",
    "ANGLE_OF_ATTACK_MODEL": "degree",
    **dict.fromkeys(
        (
            "GLIDER_SPEED_MODEL", "GLIDER_HORZ_VELO_MODEL", "GLIDER_VERT_VELO_MODEL",
            "GLIDER_SURGE_MODEL", "GLIDER_SWAY_MODEL", "VERT_CURR_MODEL", "DAC_NORTH_MODEL",
            "DAC_EAST_MODEL", "DAC_SD_MODEL", "DAC_NORTH", "DAC_EAST", "DAVG_CURR_NORTH",
            "DAVG_CURR_EAST",
        ),
        VELOCITY,
    ),
}  # fmt: skip
"""Units, as UDUNITS writes them, of the variables that the format names and a store has not: a
store's own signals keep theirs"""
MEASURED = SIMULATED_MEASURED + CTD_MEASURED + LOGGED_MEASURED
LONG_NAMES = {
    "measured_pressure": "sea water pressure, equals 0 at sea level, by the transducer",
    "measured_dvl_surge": "DVL velocity relative to DVL_MODE, forward",
    "measured_dvl_sway": "DVL velocity relative to DVL_MODE, starboard",
    "measured_dvl_heave": "DVL velocity relative to DVL_MODE, down",
}
"""Of signals whose own long name would mislead in this format"""
SENSOR_TYPES = "https://vocab.nerc.ac.uk/collection/L05/current/"
SENSORS = {
    "SENSOR_PRESSURE": ("pressure", "pressure transducer", "pressure transducer"),
    "SENSOR_AHRS": (
        "imu",
        "attitude and heading reference",
        "Microstrain 3DM-GX5-25 attitude and heading reference",
    ),
    "SENSOR_DVL": ("dvl", "Doppler velocity log", "LinkQuest 600 kHz micro DVL"),
    "SENSOR_CTD": (
        "ctd",
        "conductivity, temperature and depth sensor",
        "Sea-Bird Glider Payload CTD",
    ),
}
"""Sensor variable: device of the sensor suite, what it is, and the model whose errors it has"""


def sensor_attributes(run: GeneratedStore | StoredFlight, name: str) -> dict[str, str]:
    """Attributes of a sensor variable; a device without errors is nobody's model."""
    device, kind, model = SENSORS[name]
    settings = getattr(run.suite, device)
    called = f"simulated {model}"
    if not getattr(settings, "fitted", True):
        called = f"none: this vehicle has no {kind}"
    elif settings == getattr(SensorSuite.preset("ideal"), device):
        called = f"simulated ideal {kind}"
    return {
        "long_name": called,
        "sensor_model": called,
        "sensor_model_vocabulary": "n/a",
        "sensor_maker": "none: simulation",
        "sensor_serial_number": "n/a",
        "sensor_type_vocabulary": SENSOR_TYPES,
        "comment": "simulated",
    }


def stamp(moment: datetime.datetime) -> str:
    """The moment as the format writes it."""
    return moment.strftime("%Y%m%dT%H%M%S")


def bounds(latitude: Array, longitude: Array, depth: Array) -> dict[str, float | str]:
    """ACDD's limits of the data, which search engines of data portals read."""
    limits: dict[str, float | str] = {"geospatial_vertical_positive": "down"}
    for name, values, units in (
        ("lat", latitude, UNITS["LATITUDE"]),
        ("lon", longitude, UNITS["LONGITUDE"]),
        ("vertical", depth, UNITS["DEPTH"]),
    ):
        if np.isfinite(values).any():  # a log without fixes has no place
            limits[f"geospatial_{name}_min"] = float(np.nanmin(values))
            limits[f"geospatial_{name}_max"] = float(np.nanmax(values))
            limits[f"geospatial_{name}_units"] = units
    if "geospatial_lat_min" in limits and "geospatial_lon_min" in limits:
        south, north = limits["geospatial_lat_min"], limits["geospatial_lat_max"]
        west, east = limits["geospatial_lon_min"], limits["geospatial_lon_max"]
        corners = ((south, west), (north, west), (north, east), (south, east), (south, west))
        text = ", ".join(f"{a:.5f} {b:.5f}" for a, b in corners)
        limits["geospatial_bounds"] = f"POLYGON (({text}))"
        limits["geospatial_bounds_crs"] = "EPSG:4326"
        limits["geospatial_bounds_vertical_crs"] = "EPSG:5831"
    return limits


KEYWORDS = (
    "EARTH SCIENCE > OCEANS > OCEAN TEMPERATURE > WATER TEMPERATURE, "
    "EARTH SCIENCE > OCEANS > SALINITY/DENSITY > SALINITY, "
    "EARTH SCIENCE > OCEANS > OCEAN CIRCULATION > OCEAN CURRENTS"
)
"""GCMD's, of what gliders measure"""
FORMAT = {
    "featureType": "trajectory",
    "cdm_data_type": "Trajectory",
    # attributes are ACDD-1.3's, which wants a standard name of each variable: CF has none of a
    # rudder or a pump, so that the convention is not declared
    "Conventions": "CF-1.10, OG-1.0",
    "standard_name_vocabulary": "CF Standard Name Table v93",
}
"""What every file says of its layout"""


def global_attributes(facts: SimulatedMission, mission: int, metadata: Metadata) -> dict[str, Any]:
    """Global attributes; those that depend on the data are `bounds`."""
    serial = f"sim{mission:06d}"
    start = stamp(facts.start)
    end = facts.start + datetime.timedelta(seconds=facts.duration)
    own = {
        "title": "SIMULATED OceanGliders trajectory file",
        "summary": "Simulated underwater glider mission: not an observation of the ocean.",
        "platform": "sub-surface gliders",
        "platform_vocabulary": PLATFORM,
        "id": f"{serial}_{start}_delayed",
        "naming_authority": "glider-twin",
        "institution": "none: simulation",
        "internal_mission_identifier": facts.name,
        "time_coverage_start": start,
        "time_coverage_end": stamp(end),
        "contributor_name": "glider-twin simulation",
        "contributor_email": "n/a",
        "contributor_role": "originator",
        "contributor_role_vocabulary": ROLES,
        "contributing_institutions": "none: simulation",
        "contributing_institutions_role": "Operator",
        "contributing_institutions_role_vocabulary": ROLES,
        "rtqc_method": "No QC applied",
        "rtqc_method_doi": "n/a",
        "comment": f"SIMULATED DATA. {facts.said} LATITUDE and LONGITUDE are dead-reckoned as "
        "interpolation_methodology says, TRUE_* variables what really happened in the simulation.",
        "source": facts.source,
        "history": facts.history,
        "references": OG_FORMAT,
        "start_date": start,
        "date_created": stamp(made_at()),
        "keywords": f"simulation, {KEYWORDS}",
        "keywords_vocabulary": "GCMD Science Keywords",
        "processing_level": "simulated sensors, as measured",
        **FORMAT,
    }
    return with_metadata(own, metadata, simulated=True)


def log_attributes(logs: LogStore, missions: Sequence[int], metadata: Metadata) -> dict[str, Any]:
    """Global attributes of a file of logged dives `missions`, of one deployment in time order."""
    deployment = logs.deployments[missions[0]]
    first, last = missions[0], missions[-1]
    start, end = (
        stamp(datetime.datetime.fromtimestamp(float(unix), datetime.UTC))
        for unix in (logs.starts[first], logs.time(last)[-1])
    )
    serial = file_names(logs.deployments, "glider", "-")[deployment]
    kind = "SIMULATED OceanGliders" if logs.simulated else "OceanGliders"
    files = logs.files
    own = {
        "title": f"{kind} trajectory file, deployment {deployment}",
        "summary": f"{len(missions)} dives of deployment {deployment}, {logs.platform}.",
        "platform": "sub-surface gliders",
        "platform_vocabulary": PLATFORM,
        "id": f"{serial}_{start}_delayed",
        "naming_authority": "glider-twin",
        "institution": NOT_LOGGED,
        "internal_mission_identifier": deployment,
        "time_coverage_start": start,
        "time_coverage_end": end,
        "contributor_name": NOT_LOGGED,
        "contributor_email": "n/a",
        "contributor_role": "n/a",
        "contributor_role_vocabulary": ROLES,
        "contributing_institutions": NOT_LOGGED,
        "contributing_institutions_role": "Operator",
        "contributing_institutions_role_vocabulary": ROLES,
        "rtqc_method": "No QC applied",
        "rtqc_method_doi": "n/a",
        "comment": ON_A_GRID,
        "source": f"logs of a vehicle ({logs.source}: {files}), read by glider-twin {__version__}",
        "history": logs.history,
        "references": OG_FORMAT,
        "start_date": start,
        "date_created": stamp(made_at()),
        "keywords": KEYWORDS,
        "keywords_vocabulary": "GCMD Science Keywords",
        "processing_level": "sensor values as logged, cleaned of impossible ones, on a time grid",
        **FORMAT,
    }
    return with_metadata(own, metadata, simulated=logs.simulated)


ON_A_GRID = (
    "On one time grid for each dive; LATITUDE and LONGITUDE between the fixes are "
    "as interpolation_methodology says. Attitude and PRES are missing where the log had gaps."
)
NOT_LOGGED = "unknown: the log does not say"
"""Value of attributes that the format demands and a vehicle's log cannot know"""
