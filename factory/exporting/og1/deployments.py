"""Deployments of logs as OG1.0 files: one file each, with real time and position.

The dives of a deployment follow each other in its file. Attitude and pressure are left out where
the import bridged a gap, as they were never measured. Depth is a coordinate and stays complete.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.exporting.base import Advance, no_progress
from factory.exporting.metadata import Metadata
from factory.exporting.og1.flight_terms import (
    FlownTracks,
    JoinedDives,
    conductivity,
    flight_terms,
    flown,
    payload,
)
from factory.exporting.og1.missions import corrected_places, gps_fixes, tracks
from factory.exporting.og1.og1_terms import (
    ASCENT,
    COORDINATES,
    DESCENT,
    INFLECTION,
    MEASURED,
    NOT_LOGGED,
    RAW_TIMES,
    SURFACING,
    TERMS,
    TRACKS,
    VARIATION,
    log_attributes,
)
from factory.exporting.og1.variables import (
    ENDING,
    Og1Variable,
    Variables,
    quality,
    variable,
    write_og1,
)
from factory.exporting.og1.variables import deployment as deployment_variables
from twin.records.logged import LogStore
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

GAPPED = ("measured_pitch", "measured_roll", "measured_heading", "measured_pressure")
"""Signals that are left out where `measured_gap` marks them as interpolated."""
PROFILER = (
    *("true_speed", "true_surge", "true_sway", "true_heave"),
    *("true_current_north", "true_current_east"),
)
"""Signals that a Doppler log or profiler measured."""
SENSOR_NAMES = {"SENSOR_AHRS": "attitude and heading sensor"}
"""Names of sensors of logs, if they differ from those of simulated missions."""
DVL_MODE = "measured_dvl_mode"
NOT_COPIED = frozenset(
    {
        *("measured_depth", "measured_phase", "measured_gap", DVL_MODE),
        *("measured_gps_north", "measured_gps_east", *TERMS["payload"]),
        *(f"{stored}_{axis}" for stored, _, _ in TRACKS for axis in ("north", "east")),
    }
)
"""Signals that `_series` does not copy: their variables are made from them elsewhere."""
PHASE_CODES = np.array([SURFACING, DESCENT, ASCENT, INFLECTION])
"""Codes of the format by the flag of `measured_phase`."""


def export_og1_logs(
    logs: LogStore,
    missions: Sequence[int],
    folder: Path,
    advance: Advance = no_progress,
    *,
    vehicle: str | None = None,
    metadata: Metadata | None = None,
) -> list[Path]:
    """Write one file for each deployment that `missions` belong to; return their paths.

    Args:
      logs: the store.
      missions: rows of the store.
      folder: for the files.
      advance: called for each dive that is written.
      vehicle: file or name of the vehicle whose flight model makes track and velocities; default
        the shipped one of the log's type.
      metadata: facts on the deployment that the logs lack.

    Raises:
      StoreError: no such mission, or its data cannot be read.
      OSError: the disk refuses.
    """
    for mission in missions:
        logs.check_mission(mission)
    metadata = metadata or Metadata()
    found = flown(logs, missions, vehicle)
    paths = []
    for deployment in dict.fromkeys(logs.deployments[mission] for mission in missions):
        chosen = [k for k in logs.missions_of(deployment) if k in set(missions)]
        track = _track(logs, chosen)
        identity = {**log_attributes(logs, chosen, metadata), "flight_model": found.model}
        series = _series(track, deployment, found, metadata)
        paths.append(write_og1(folder, identity, series, len(track.order)))
        for _ in chosen:
            advance()
    return paths


def _track(logs: LogStore, missions: Sequence[int]) -> JoinedDives:
    time = np.concatenate([logs.time(mission) for mission in missions])
    # a dive begins with the last sample of the dive before, if no surface interval is between them
    reversed_unique = np.unique(time[::-1], return_index=True)[1]
    return JoinedDives(logs, tuple(missions), len(time) - 1 - reversed_unique)


def _series(
    track: JoinedDives, deployment: str, found: FlownTracks, metadata: Metadata
) -> Variables:
    logs = track.logs
    yield variable("TRAJECTORY", deployment)
    yield variable("WMO_IDENTIFIER", metadata.wmo or NOT_LOGGED)
    yield variable("PLATFORM_MODEL", metadata.model or logs.platform)
    yield variable("PLATFORM_SERIAL_NUMBER", metadata.serial or deployment)
    time = track.gather(logs.time)
    yield variable("TIME", time, ancillary_variables=f"TIME{ENDING}")
    yield quality("TIME", time)
    yield from corrected_places(track, found)
    yield from tracks(track)
    gap = track.signal("measured_gap") > 0.0
    depth = track.signal("measured_depth")
    yield variable(
        "DEPTH",
        np.maximum(depth, 0.0),
        long_name="depth below the surface, TEOS-10 from pressure",
        comment="interpolated where PRES is missing; above the surface 0, PRES keeps it",
    )
    yield quality("DEPTH", depth, estimated=gap)
    yield from gps_fixes(track, time)
    yield from deployment_variables(time[0], *logs.fixes(track.missions[0])[0])
    codes, how = _phase(track.signal("measured_phase")), "depth and its rate over 20 s"
    yield variable("PHASE", codes, phase_calculation_method=how)
    yield variable("DIVE_NUMBER", track.repeated("dive"))
    if "magnetic_variation" in logs.dataset:
        yield variable(VARIATION, track.repeated("magnetic_variation"))
    seen = set(logs.signals())
    fitted = [sensor for _, stored, sensor in MEASURED if sensor and stored in seen]
    for name in dict.fromkeys(fitted):
        yield variable(name, 0, like="sensor", **_sensor(name, metadata))
    for name, stored, sensor in MEASURED:
        if stored in seen:
            values = track.signal(stored)
            if stored in GAPPED:
                values = np.where(gap, np.nan, values)
            own = {"sensor": sensor} if sensor else {}
            if sensor:
                own["ancillary_variables"] = f"{name}{ENDING}"
                yield quality(name, values)
            yield _signal(name, values, stored, **own)
    yield from conductivity(track)
    yield from payload(track)
    written = {stored for _, stored, _ in MEASURED} | {*PROFILER, *NOT_COPIED, *RAW_TIMES}
    # then parts of other vehicles, commands, any payload
    others = [stored for stored in logs.signals() if stored not in written]
    for stored in (*(stored for stored in PROFILER if stored in seen), *others):
        yield _signal(stored.upper(), track.signal(stored), stored)
    if DVL_MODE in seen:
        word = VARIABLES[DVL_MODE].long_name
        yield variable("DVL_MODE", track.signal(DVL_MODE), long_name=word)
    for stored, name in RAW_TIMES.items():
        if stored in seen:
            word = VARIABLES[stored].long_name
            values = _raw_time(track, stored)
            yield variable(name, values, like="moment", long_name=word, coordinates=COORDINATES)
    yield from flight_terms(track, found)
    yield from _currents(track)


def _raw_time(track: JoinedDives, stored: str) -> Array:
    """Times of the original samples, which the store counts from each row's start."""
    logs = track.logs
    return track.gather(lambda mission: logs.starts[mission] + logs.signal(stored, mission))


def _phase(flag: Array) -> Array:
    known = np.isfinite(flag)
    return np.where(known, PHASE_CODES[np.where(known, flag, 0).astype(int)], 0)


def _currents(track: JoinedDives) -> Variables:
    """Depth-averaged currents of the dives as stored, repeated at their samples."""
    for axis in ("north", "east"):
        for stored, name in (
            (f"dac_{axis}", f"DAC_{axis.upper()}"),
            (f"vehicle_dac_{axis}", f"DAVG_CURR_{axis.upper()}"),
        ):
            if stored in track.logs.dataset:
                word = str(track.logs.dataset[stored].attrs["long_name"])
                yield variable(name, track.repeated(stored), long_name=word)


def _sensor(name: str, metadata: Metadata) -> dict[str, str]:
    known = metadata.sensor(name)
    usual = SENSOR_NAMES.get(name, TERMS["sensors"][name][1])
    found = {
        ours: next((known[word] for word in theirs if word in known), otherwise)
        for ours, theirs, otherwise in (
            ("long_name", ("long_name",), usual),
            ("sensor_model", ("make_model", "model"), NOT_LOGGED),
            ("sensor_maker", ("make", "maker"), NOT_LOGGED),
            ("sensor_serial_number", ("serial_number", "serial"), "n/a"),
            ("sensor_calibration_date", ("calibration_date", "factory_calibrated"), ""),
            ("comment", ("comment",), ""),
        )
    }
    return {ours: words for ours, words in found.items() if words}


def _signal(name: str, values: Array, stored: str, **more: str) -> tuple[str, Og1Variable]:
    known = VARIABLES[stored].attributes()
    known["long_name"] = TERMS["long_names"].get(stored, known["long_name"])
    return variable(name, values, like="signal", **{**known, **more})
