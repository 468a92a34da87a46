"""Vocabulary of OG1.0 files: names of signals, words of the deployment, and quality flags.

`MADE_AGAIN` lists variables that the import computes anew from others.
`deployment_words` collects the description of a deployment from a file's attributes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.metadata import INSTRUMENTS
from factory.exporting.og1.og1_terms import (
    MEASURED,
    NOT_LOGGED,
    RAW_TIMES,
    TERMS,
    TRACKS,
    VARIATION,
)
from factory.exporting.og1.variables import ENDING
from factory.importing.netcdf import as_array, attributes_of, text_of
from factory.importing.tally import Tally, leave_out

DIMENSION = "N_MEASUREMENTS"
OURS = {name: stored for name, stored, _ in MEASURED} | {"DVL_MODE": "measured_dvl_mode"}
"""Names that `factory export` writes, and the store's. Further signals have the store's name in
capitals, and the attribute `signal_group`."""
PAYLOAD = tuple(name for name, _ in TERMS["payload"].values())
"""OG1.0 names of payload measurements."""
ALIASES = {
    "measured_pitch": ("PITCH", "GLIDER_PITCH"),
    "measured_roll": ("ROLL", "GLIDER_ROLL"),
    "measured_heading": ("HEADING", "GLIDER_HEADING", "HEADING_TRUE"),
    "measured_pressure": ("PRES", "PRES_ADJUSTED", "NAV_PRESSURE"),
    "measured_depth": ("DEPTH", "DEPTH_Z", "GLIDER_DEPTH"),
    "measured_pump": (
        "PUMPED_VOLUME",
        "VBD_CC",
        "BUOYANCY_CC",
        "OIL_VOLUME",
        "BALLAST_CC",
        "eng_vbdCC",
    ),
}
"""Names seen in OG1.0 files for channels of the store, in order of preference."""
TEMPERATURES = ("TEMP", "TEMP_ADJUSTED", "TEMP_RAW")
SALINITIES = ("PSAL", "PSAL_ADJUSTED", "PSAL_RAW")
CONDUCTIVITIES = ("CNDC", "CNDC_RAW")
DIVES = ("dive_num", "divenum", "DIVE_NUMBER")
"""Names of dive numbers in files converted from Seaglider files."""
CORRECTED = "POSITION_SD"
"""Variable that only files of `factory export` have, with a track corrected at the fixes."""
RECKONED = "DEAD_RECKONING"
"""Variable of other files: 1 where a position is dead-reckoned, 0 at a GPS fix."""
CURRENTS = {"dac_north": "DAVG_CURR_NORTH", "dac_east": "DAVG_CURR_EAST"}
"""[m/s] Reported depth-averaged current, at the measurements of its dive."""
REPORTED = {"DAC_NORTH": "DAVG_CURR_NORTH", "DAC_EAST": "DAVG_CURR_EAST"}
"""Names of the reported current in other files; in an export they hold the current by the fixes."""
ORIGINAL_TIMES = {stored.removesuffix("_time"): name for stored, name in RAW_TIMES.items()}
"""Times of the original samples of the grid, by the kind of sample."""
OWN_TRACK, WAYPOINT, TRUE_TRACK = (
    tuple(ending.format(axis) for axis in ("LATITUDE", "LONGITUDE")) for _, ending, _ in TRACKS
)
DEPLOYED = ("DEPLOYMENT_TIME", "DEPLOYMENT_LATITUDE", "DEPLOYMENT_LONGITUDE")
_IDENTITY = (
    "TRAJECTORY", "trajectory", "PLATFORM_MODEL", "PLATFORM_SERIAL_NUMBER", "WMO_IDENTIFIER"
)  # fmt: skip
READ = (
    *OURS, *(name for names in ALIASES.values() for name in names), *TEMPERATURES, *SALINITIES,
    *CONDUCTIVITIES, "LATITUDE", "LONGITUDE", "LATITUDE_GPS", "LONGITUDE_GPS", "TIME", "TIME_GPS",
    *OWN_TRACK, *WAYPOINT, *TRUE_TRACK, *ORIGINAL_TIMES.values(), VARIATION,
    *DIVES, *CURRENTS.values(), *_IDENTITY, *PAYLOAD,
)  # fmt: skip
MADE_AGAIN = {
    r"(GLIDER_|ANGLE_OF_|VERT_CURR_|DAC_)\w+_MODEL|VERT_CURR_MODEL": "a flight model's: `twin "
    "flight` and an export make it of the other variables",
    r"DAC_NORTH|DAC_EAST": "the import makes it of the fixes, depth and attitude",
    r"PHASE": "phases follow from the depth",
    r"POSITION_SD|DEAD_RECKONING": "of a track corrected at the fixes",
    "|".join(DEPLOYED): "fixes say where the rows begin",
}
"""Patterns of names that are not read, with the reason why nothing is lost."""


def leave_out_made_again(present: Iterable[str], read: Iterable[str], tally: Tally) -> None:
    """Leave out names that the import computes from others, each with the reason."""
    unread = [name for name in present if name not in set(read)]
    for expression, why in MADE_AGAIN.items():
        found = [name for name in unread if re.fullmatch(expression, name)]
        leave_out(found, why, tally, together="OG1 file")


PEOPLE = frozenset(
    {
        "title", "summary", "comment", "acknowledgement", "acknowledgment", "institution",
        "license", "project", "program", "network", "site", "sea_name", "naming_authority", "doi",
        "principal_investigator", "principal_investigator_email", "rtqc_method", "rtqc_method_doi",
        "contributing_institutions", "contributing_institutions_role",
        "contributing_institutions_vocabulary", "contributing_institutions_role_vocabulary",
        "references", "keywords", "keywords_vocabulary",
    }
)  # fmt: skip
_PERSON = re.compile(r"(creator|publisher|contributor)_\w+")
_OURS = re.compile(r"(SIMULATED )?OceanGliders trajectory file, deployment .*|\d+ dives of .*")
"""Title and summary that an export writes by itself."""
_NOTHING = frozenset({"", "n/a", "glider-twin", "No QC applied", NOT_LOGGED})
_DEVICE = {"long_name": "long_name", "sensor_model": "make_model", "sensor_maker": "make",
           "sensor_serial_number": "serial_number", "sensor_calibration_date": "calibration_date",
           "comment": "comment"}  # fmt: skip


def deployment_words(file: Any, deployment: str) -> str | None:
    """Description of the deployment from a file's attributes, as JSON (valid YAML), or None."""
    said = {}
    for name in file.ncattrs():
        value = " ".join(str(file.getncattr(name)).replace(TERMS["logged"]["comment"], "").split())
        by_people = name in PEOPLE or _PERSON.fullmatch(name)
        if by_people and value not in _NOTHING and not _OURS.fullmatch(value):
            said[name] = value
    for name, variable, usual in (
        ("wmo_id", "WMO_IDENTIFIER", ""),
        ("glider_serial", "PLATFORM_SERIAL_NUMBER", deployment),
    ):
        value = text_of(file.variables.get(variable)).strip()
        if value not in {*_NOTHING, usual}:
            said[name] = value
    devices = {}
    for sensor, words in INSTRUMENTS.items():
        named = [variable for name, variable in file.variables.items() if name.startswith(sensor)]
        described = attributes_of(named[0]) if named else {}
        found = {
            ours: str(described[theirs])
            for theirs, ours in _DEVICE.items()
            if theirs in described and str(described[theirs]) not in _NOTHING
        }
        if set(found) - {"long_name"}:
            devices[words[0]] = found
    if not said and not devices:
        return None
    return json.dumps({"metadata": said, "glider_devices": devices}, ensure_ascii=False)


Array = NDArray[np.float64]

BAD = (3, 4)
"""Flags of Argo reference table 2: bad, and bad unless corrected."""
NO_FIX = (*BAD, 8, 9)
"""Flags of a bad fix; 8 is estimated, 9 missing."""


def flags_of(variables: Mapping[str, Any], raw: Mapping[str, Array]) -> dict[str, Array]:
    """Quality flags by the name of the variable, (samples,) each, for variables with flags."""
    found = {}
    for name, values in raw.items():
        flag = variables.get(f"{name}{ENDING}")
        if flag is None or flag.dtype == str or flag.dtype.kind not in "fiuS":
            continue
        codes = _digits(flag[:]) if flag.dtype.kind == "S" else as_array(flag[:])
        if len(codes) == len(values):
            found[name] = codes
    return found


def _digits(letters: Any) -> Array:
    """Flags that are written as letters; NaN for a letter that is no digit."""
    every = np.ravel(np.ma.filled(letters, b" ")).tolist()
    return np.array([float(one) if one.isdigit() else np.nan for one in every])


def without_bad(name: str, values: Array, flags: Mapping[str, Array], tally: Tally) -> Array:
    """Remove values that the file flags as bad; count them."""
    if name not in flags:
        return values
    codes = NO_FIX if name.endswith("_GPS") else BAD
    bad = np.isin(flags[name], codes) & np.isfinite(values)
    why = f"bad by the file's own flags ({', '.join(map(str, codes))})"
    return tally.removed(values, bad, name, why)
