"""Logged deployments as OG1.0 files: one file each, with real time and place.

One file for each deployment, as the format wants; the dives follow each other in it. Attitude and
pressure are left out where the import had bridged a gap: they were never measured. Depth is a
coordinate and stays complete.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.base import Advance, no_progress
from factory.exporting.og1.terms import (
    ASCENT,
    COORDINATES,
    DESCENT,
    FILL,
    INFLECTION,
    LONG_NAMES,
    MEASURED,
    NOT_LOGGED,
    PHASE_FLAGS,
    PHASES,
    SENSOR_TYPES,
    SURFACING,
    TIME_FILL,
    VOCABULARY,
    log_attributes,
)
from factory.exporting.og1.variables import (
    Og1Variable,
    deployment_place,
    flags,
    position,
    text,
    time_attributes,
    write_og1,
)
from twin.records.logs import LogStore
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
PHASE_CODES = np.array([SURFACING, DESCENT, ASCENT, INFLECTION])
"""By the flag of `measured_phase`"""


@dataclass(frozen=True)
class JoinedDives:
    """The dives of one file on one time axis, which increases strictly."""

    logs: LogStore
    missions: tuple[int, ...]
    order: NDArray[np.intp]
    """Samples that are kept, of all dives put behind each other."""

    def gather(self, of: Callable[[int], Array]) -> Array:
        """What `of` says about each dive, as one array (samples,)."""
        return np.concatenate([of(mission) for mission in self.missions])[self.order]

    def signal(self, name: str) -> Array:
        """A stored signal, (samples,)."""
        return self.gather(lambda mission: self.logs.signal(name, mission))

    def repeated(self, name: str) -> Array:
        """A number of each dive at each of its samples, (samples,)."""
        values = self.logs.number(name)
        return self.gather(
            lambda mission: np.full(int(self.logs.samples[mission]), values[mission])
        )


def export_og1_logs(
    logs: LogStore, missions: Sequence[int], folder: Path, advance: Advance = no_progress
) -> list[Path]:
    """Write one file for each deployment that `missions` belong to; returns their paths.

    Raises:
      StoreError: no such mission, or its data cannot be read.
      InputError: the disk refuses.
    """
    for mission in missions:
        logs.check_mission(mission)
    paths = []
    for deployment in dict.fromkeys(logs.deployments[mission] for mission in missions):
        chosen = [k for k in logs.missions_of(deployment) if k in set(missions)]
        track = _track(logs, chosen)
        identity = log_attributes(logs, chosen)
        series = _series(track, deployment)
        paths.append(write_og1(folder, identity, series, len(track.order)))
        for _ in chosen:
            advance()
    return paths


def _track(logs: LogStore, missions: Sequence[int]) -> JoinedDives:
    time = np.concatenate([logs.time(mission) for mission in missions])
    # a fix between two dives without a stay at the surface ends one and begins the other
    reversed_unique = np.unique(time[::-1], return_index=True)[1]
    return JoinedDives(logs, tuple(missions), len(time) - 1 - reversed_unique)


def _series(track: JoinedDives, deployment: str) -> Iterator[tuple[str, Og1Variable]]:
    logs = track.logs
    at = {"coordinates": COORDINATES}
    yield "TRAJECTORY", text(deployment, "trajectory name", cf_role="trajectory_id")
    yield "WMO_IDENTIFIER", text(NOT_LOGGED, "wmo id")
    model = {"platform_model_vocabulary": "n/a"}
    yield "PLATFORM_MODEL", text(logs.platform, "model of the glider", **model)
    yield "PLATFORM_SERIAL_NUMBER", text(deployment, "glider serial number")
    time = track.gather(logs.time)
    elapsed = time_attributes("Time elapsed since 1970-01-01T00:00:00Z")
    elapsed["time_vocabulary"] = VOCABULARY + "TIME/"
    yield "TIME", Og1Variable(time, elapsed, TIME_FILL)
    yield from _places(track)
    yield "DEPTH", _depth(track.signal("measured_depth"))
    yield from _gps(track, time)
    start = np.array(time[0])
    yield (
        "DEPLOYMENT_TIME",
        Og1Variable(start, time_attributes("date of deployment"), dimensions=()),
    )
    yield from deployment_place(*logs.fixes(track.missions[0])[0])
    yield "PHASE", _phase(track.signal("measured_phase"))
    dive = {"long_name": "number of the dive", "units": "1", **at}
    yield "DIVE_NUMBER", Og1Variable(track.repeated("dive"), dive, fill=-1, kind="i4")
    gap = track.signal("measured_gap") > 0.0
    seen = set(logs.signals())
    fitted = [sensor for _, stored, sensor in MEASURED if sensor and stored in seen]
    for name in dict.fromkeys(fitted):
        yield name, _sensor(name)
    for name, stored, sensor in MEASURED:
        if stored in seen:
            values = track.signal(stored)
            if stored in GAPPED:
                values = np.where(gap, np.nan, values)
            yield name, _signal(values, stored, {"sensor": sensor} if sensor else {})
    for stored in PROFILER:
        if stored in seen:
            yield stored.upper(), _signal(track.signal(stored), stored, {})
    yield from _currents(track)


def _places(track: JoinedDives) -> Iterator[tuple[str, Og1Variable]]:
    found = [track.logs.positions(mission) for mission in track.missions]
    methods = ", ".join(dict.fromkeys(method for _, _, method in found))
    method = {"interpolation_methodology": methods}
    longitude = _wrap(np.concatenate([one[1] for one in found])[track.order])
    latitude = np.concatenate([one[0] for one in found])[track.order]
    own = {**method, "longitude_vocabulary": VOCABULARY + "LON/"}
    long_name = "longitude of each measurement and GPS location"
    yield "LONGITUDE", position(longitude, long_name, "longitude", own)
    own = {**method, "latitude_vocabulary": VOCABULARY + "LAT/"}
    yield "LATITUDE", position(latitude, "Latitude north (WGS84)", "latitude", own)


def _gps(track: JoinedDives, time: Array) -> Iterator[tuple[str, Og1Variable]]:
    """The fixes at the ends of the dives, each at its own time beside the nearest sample."""
    logs = track.logs
    places = np.full((3, len(time)), np.nan)
    for mission in track.missions:
        start, end = logs.fixes(mission)
        begin = logs.starts[mission]
        last = begin + float(logs.log_rows[mission].duration)
        for when, fix in ((begin, start), (last, end)):
            if np.isfinite([*fix, when]).all():
                places[:, int(np.argmin(np.abs(time - when)))] = when, *fix
    at = {"coordinates": COORDINATES}
    yield (
        "TIME_GPS",
        Og1Variable(places[0], time_attributes("time of each GPS location"), TIME_FILL),
    )
    yield (
        "LONGITUDE_GPS",
        position(_wrap(places[2]), "longitude of each GPS location", "longitude", at),
    )
    yield "LATITUDE_GPS", position(places[1], "latitude of each GPS location", "latitude", at)


def _wrap(longitude: Array) -> Array:
    return np.asarray(np.mod(longitude + 180.0, 360.0) - 180.0)


def _depth(depth: Array) -> Og1Variable:
    return Og1Variable(
        np.maximum(depth, 0.0),
        {
            "long_name": "depth below the surface, TEOS-10 from pressure",
            "standard_name": "depth",
            "units": "m",
            "positive": "down",
            "axis": "Z",
            "valid_min": 0.0,
            "valid_max": 10000.0,
            "depth_vocabulary": VOCABULARY + "DEPTH/",
            "comment": "interpolated where PRES is missing; above the surface 0, PRES keeps it",
        },
        fill=FILL,
    )


def _phase(flag: Array) -> Og1Variable:
    known = np.isfinite(flag)
    codes = np.where(known, PHASE_CODES[np.where(known, flag, 0).astype(int)], 0)
    return Og1Variable(
        codes,
        {
            "long_name": "behavior of the glider at sea",
            "phase_vocabulary": PHASES,
            "phase_calculation_method": "depth and its rate over 20 s",
            **flags(PHASE_FLAGS),
            "coordinates": COORDINATES,
        },
        fill=0,
        kind="i1",
    )


def _currents(track: JoinedDives) -> Iterator[tuple[str, Og1Variable]]:
    """Depth-averaged currents of the dives, repeated at their samples."""
    for axis, standard in (("north", "northward"), ("east", "eastward")):
        for stored in (f"dac_{axis}", f"vehicle_dac_{axis}"):
            if stored in track.logs.dataset:
                attributes = {
                    "long_name": str(track.logs.dataset[stored].attrs["long_name"]),
                    "standard_name": f"{standard}_sea_water_velocity",
                    "units": "m s-1",
                    "coordinates": COORDINATES,
                    "comment": "mean over the depths of the dive",
                }
                yield (
                    stored.upper(),
                    Og1Variable(track.repeated(stored), attributes, fill=np.nan, kind="f4"),
                )


def _sensor(name: str) -> Og1Variable:
    attributes = {
        "long_name": SENSOR_NAMES[name],
        "sensor_model": NOT_LOGGED,
        "sensor_model_vocabulary": "n/a",
        "sensor_maker": NOT_LOGGED,
        "sensor_serial_number": "n/a",
        "sensor_type_vocabulary": SENSOR_TYPES,
    }
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
