"""Names: what OG1.0 files call the signals of a store, and what is made of the others again."""

from __future__ import annotations

import re
from collections.abc import Iterable

from factory.exporting.og1.terms import MEASURED, PAYLOAD, RAW_TIMES, TRACKS, VARIATION
from factory.importing.reading.tally import Tally
from factory.importing.reading.unread_names import leave_out

DIMENSION = "N_MEASUREMENTS"
OURS = {name: stored for name, stored, _ in MEASURED} | {"DVL_MODE": "measured_dvl_mode"}
"""Names that `factory export` writes, and the store's. Further signals have the store's name in
capitals, and its attribute `signal_group`."""
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
"""Numbers of the dives, as converters from Seaglider files keep them."""
CORRECTED = "POSITION_SD"
"""Files of `factory export` have it beside a track that is corrected at the fixes."""
CURRENTS = {"dac_north": "DAVG_CURR_NORTH", "dac_east": "DAVG_CURR_EAST"}
"""[m/s] Reported depth-averaged current, at the measurements of its dive."""
ORIGINAL_TIMES = {stored.removesuffix("_time"): name for stored, name in RAW_TIMES.items()}
"""Times of the samples that the grid was made of, by what they are of."""
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
    *DIVES, *CURRENTS.values(), *_IDENTITY, *(name for name, _ in PAYLOAD.values()),
)  # fmt: skip
MADE_AGAIN = {
    r"(GLIDER_|ANGLE_OF_|VERT_CURR_|DAC_)\w+_MODEL|VERT_CURR_MODEL": "a flight model's: `twin "
    "flight` and an export make it of the other variables",
    r"DAC_NORTH|DAC_EAST": "the import makes it of the fixes, depth and attitude",
    r"PHASE": "phases follow from the depth",
    r"POSITION_SD|DEAD_RECKONING": "of a track corrected at the fixes",
    "|".join(DEPLOYED): "fixes say where the rows begin",
}
"""Names, as expressions, and why nothing of them is lost."""


def leave_out_made_again(present: Iterable[str], read: Iterable[str], tally: Tally) -> None:
    """Names of which nothing is read because the import has it from others, each with the why."""
    unread = [name for name in present if name not in set(read)]
    for expression, why in MADE_AGAIN.items():
        found = [name for name in unread if re.fullmatch(expression, name)]
        leave_out(found, why, tally, together="OG1 file")
