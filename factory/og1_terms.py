"""Terms of OG1.0: vocabularies, names and global attributes, as simulated missions fill them."""

from __future__ import annotations

import datetime
from typing import Any

from factory.stored import StoredRun
from twin.version import __version__

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


def _stamp(moment: datetime.datetime) -> str:
    return moment.strftime("%Y%m%dT%H%M%S")


def global_attributes(run: StoredRun, mission: int) -> dict[str, Any]:
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
