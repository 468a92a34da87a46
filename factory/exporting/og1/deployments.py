"""Logged deployments as OG1.0 files: one file each, with real time and place.

One file for each deployment, as the format wants; the dives follow each other in it. Attitude and
pressure are left out where the import had bridged a gap: they were never measured. Depth is a
coordinate and stays complete.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.base import Advance, no_progress
from factory.exporting.metadata import Metadata
from factory.exporting.og1.flight_terms import JoinedDives, conductivity, flight_terms, payload
from factory.exporting.og1.flown_track import FlownTracks, flown
from factory.exporting.og1.missions import corrected_places, gps_fixes, tracks
from factory.exporting.og1.og1_terms import (
    ASCENT,
    COORDINATES,
    DESCENT,
    INFLECTION,
    LONG_NAMES,
    MEASURED,
    NOT_LOGGED,
    PAYLOAD,
    RAW_TIMES,
    SENSOR_TYPES,
    SURFACING,
    TIME_FILL,
    TRACKS,
    UNITS,
    VARIATION,
    VOCABULARY,
    log_attributes,
)
from factory.exporting.og1.variables import (
    ENDING,
    Og1Variable,
    deployment_place,
    depth_variable,
    dvl_mode,
    phase_variable,
    quality,
    text,
    time_attributes,
    write_og1,
)
from twin.records.logged import LogStore
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

GAPPED = ("measured_pitch", "measured_roll", "measured_heading", "measured_pressure")
"""Left out where `measured_gap` says that they are interpolated"""
PROFILER = (
    *("true_speed", "true_surge", "true_sway", "true_heave"),
    *("true_current_north", "true_current_east"),
)
"""What a Doppler log or profiler measured."""
SENSOR_NAMES = {
    "SENSOR_PRESSURE": "pressure transducer",
    "SENSOR_AHRS": "attitude and heading sensor",
    "SENSOR_CTD": "conductivity, temperature and depth sensor",
    "SENSOR_DVL": "Doppler velocity log",
}
DVL_MODE = "measured_dvl_mode"
ELSEWHERE = frozenset(
    {
        *("measured_depth", "measured_phase", "measured_gap", DVL_MODE),
        *("measured_gps_north", "measured_gps_east", *PAYLOAD),
        *(f"{stored}_{axis}" for stored, _, _ in TRACKS for axis in ("north", "east")),
    }
)
"""Signals that have variables of their own"""
PHASE_CODES = np.array([SURFACING, DESCENT, ASCENT, INFLECTION])
"""By the flag of `measured_phase`"""


def export_og1_logs(
    logs: LogStore,
    missions: Sequence[int],
    folder: Path,
    advance: Advance = no_progress,
    *,
    vehicle: str | None = None,
    metadata: Metadata | None = None,
) -> list[Path]:
    """Write one file for each deployment that `missions` belong to; returns their paths.

    Args:
      logs: the store.
      missions: rows of it.
      folder: for the files.
      advance: called for each dive that is written.
      vehicle: file or name of the vehicle whose flight model makes track and velocities; default
        the shipped one of the log's kind.
      metadata: what people know of the deployment.

    Raises:
      StoreError: no such mission, or its data cannot be read.
      InputError: the disk refuses.
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
    # a fix between two dives without a stay at the surface ends one and begins the other
    reversed_unique = np.unique(time[::-1], return_index=True)[1]
    return JoinedDives(logs, tuple(missions), len(time) - 1 - reversed_unique)


def _series(
    track: JoinedDives, deployment: str, found: FlownTracks, metadata: Metadata
) -> Iterator[tuple[str, Og1Variable]]:
    logs = track.logs
    at = {"coordinates": COORDINATES}
    yield "TRAJECTORY", text(deployment, "trajectory name", cf_role="trajectory_id")
    yield "WMO_IDENTIFIER", text(metadata.wmo or NOT_LOGGED, "wmo id")
    model = {"platform_model_vocabulary": "n/a"}
    name = metadata.model or logs.platform
    yield "PLATFORM_MODEL", text(name, "model of the glider", **model)
    serial = metadata.serial or deployment
    yield "PLATFORM_SERIAL_NUMBER", text(serial, "glider serial number")
    time = track.gather(logs.time)
    elapsed = time_attributes("Time elapsed since 1970-01-01T00:00:00Z")
    elapsed |= {"time_vocabulary": VOCABULARY + "TIME/", "axis": "T"}
    elapsed["ancillary_variables"] = f"TIME{ENDING}"
    yield "TIME", Og1Variable(time, elapsed, TIME_FILL)
    yield quality("TIME", time)
    yield from corrected_places(track, found)
    yield from tracks(track)
    gap = track.signal("measured_gap") > 0.0
    depth = track.signal("measured_depth")
    yield "DEPTH", _depth(depth)
    yield quality("DEPTH", depth, estimated=gap)
    yield from gps_fixes(track, time)
    start = np.array(time[0])
    yield (
        "DEPLOYMENT_TIME",
        Og1Variable(start, time_attributes("date of deployment"), dimensions=()),
    )
    yield from deployment_place(*logs.fixes(track.missions[0])[0])
    yield "PHASE", _phase(track.signal("measured_phase"))
    dive = {"long_name": "number of the dive", "units": UNITS["DIVE_NUMBER"], **at}
    yield "DIVE_NUMBER", Og1Variable(track.repeated("dive"), dive, fill=-1, kind="i4")
    if "magnetic_variation" in logs.dataset:
        added = {"long_name": "magnetic variation that HEADING contains, east positive", **at}
        added["units"] = UNITS[VARIATION]
        values = track.repeated("magnetic_variation")
        yield VARIATION, Og1Variable(values, added, fill=np.nan)
    seen = set(logs.signals())
    fitted = [sensor for _, stored, sensor in MEASURED if sensor and stored in seen]
    for name in dict.fromkeys(fitted):
        yield name, _sensor(name, metadata)
    for name, stored, sensor in MEASURED:
        if stored in seen:
            values = track.signal(stored)
            if stored in GAPPED:
                values = np.where(gap, np.nan, values)
            own = {"sensor": sensor} if sensor else {}
            if sensor:
                own["ancillary_variables"] = f"{name}{ENDING}"
                yield quality(name, values)
            yield name, _signal(values, stored, own)
    yield from conductivity(track)
    yield from payload(track)
    for stored in PROFILER:
        if stored in seen:
            yield stored.upper(), _signal(track.signal(stored), stored, {})
    written = {stored for _, stored, _ in MEASURED} | {*PROFILER, *ELSEWHERE}
    for stored in logs.signals():  # parts of other vehicles, commands, any payload
        if stored not in written and stored not in RAW_TIMES:
            yield stored.upper(), _signal(track.signal(stored), stored, {})
    if DVL_MODE in seen:
        yield "DVL_MODE", dvl_mode(track.signal(DVL_MODE), VARIABLES[DVL_MODE].long_name)
    for stored, name in RAW_TIMES.items():
        if stored in seen:
            yield name, _raw_time(track, stored)
    yield from flight_terms(track, found)
    yield from _currents(track)


def _raw_time(track: JoinedDives, stored: str) -> Og1Variable:
    """Times of the original samples, where the store has those since each row's start."""
    logs = track.logs
    values = track.gather(lambda mission: logs.starts[mission] + logs.signal(stored, mission))
    attributes = time_attributes(VARIABLES[stored].long_name)
    return Og1Variable(values, {**attributes, "coordinates": COORDINATES}, TIME_FILL)


def _depth(depth: Array) -> Og1Variable:
    return depth_variable(
        np.maximum(depth, 0.0),
        "depth below the surface, TEOS-10 from pressure",
        "interpolated where PRES is missing; above the surface 0, PRES keeps it",
    )


def _phase(flag: Array) -> Og1Variable:
    known = np.isfinite(flag)
    codes = np.where(known, PHASE_CODES[np.where(known, flag, 0).astype(int)], 0)
    return phase_variable(codes, "depth and its rate over 20 s")


def _currents(track: JoinedDives) -> Iterator[tuple[str, Og1Variable]]:
    """Depth-averaged currents of the dives as stored, repeated at their samples."""
    for axis, standard in (("north", "northward"), ("east", "eastward")):
        for stored, name in (
            (f"dac_{axis}", f"DAC_{axis.upper()}"),
            (f"vehicle_dac_{axis}", f"DAVG_CURR_{axis.upper()}"),
        ):
            if stored in track.logs.dataset:
                attributes = {
                    "long_name": str(track.logs.dataset[stored].attrs["long_name"]),
                    "standard_name": f"{standard}_sea_water_velocity",
                    "units": UNITS[name],
                    "coordinates": COORDINATES,
                    "comment": "mean over the depths of the dive",
                }
                yield (
                    name,
                    Og1Variable(track.repeated(stored), attributes, fill=np.nan, kind="f4"),
                )


def _sensor(name: str, metadata: Metadata) -> Og1Variable:
    known = metadata.sensor(name)
    attributes = {
        "long_name": known.get("long_name", SENSOR_NAMES[name]),
        "sensor_model": known.get("make_model", known.get("model", NOT_LOGGED)),
        "sensor_model_vocabulary": "n/a",
        "sensor_maker": known.get("make", known.get("maker", NOT_LOGGED)),
        "sensor_serial_number": known.get("serial_number", known.get("serial", "n/a")),
        "sensor_type_vocabulary": SENSOR_TYPES,
    }
    for ours, theirs in (
        ("sensor_calibration_date", ("calibration_date", "factory_calibrated")),
        ("comment", ("comment",)),
    ):
        found = next((known[word] for word in theirs if word in known), "")
        if found:
            attributes[ours] = found
    return Og1Variable(np.array(0, np.int8), attributes, dimensions=(), kind="i1")


def _signal(values: Array, stored: str, attributes: dict[str, Any]) -> Og1Variable:
    described = {
        **VARIABLES[stored].attributes(),
        "coordinates": COORDINATES,
        **attributes,
    }
    if stored in LONG_NAMES:
        described["long_name"] = LONG_NAMES[stored]
    return Og1Variable(values, described, fill=np.nan, kind="f4")
