"""Missions of a simulation as OG1.0 trajectory files: one file each, marked as simulated.

Format: OceanGliders OG1.0 terms of reference, version 1.0.0 (2024), on CF-1.10, with the attributes
of ACDD-1.3. The format has one file per deployment; here each mission has one. LATITUDE, LONGITUDE
are dead-reckoned from the glider's measurements and corrected at the fixes. *_ONBOARD is the track
that the glider logged itself. TRUE_* is the truth, which no real file has. Positions and TIME are
at the place and date of the mission; a mission without a date has a nominal date.

Here are also the positions in an OG1.0 file of a logged deployment.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.metadata import Metadata
from factory.exporting.og1.flight_terms import (
    FlownTrack,
    FlownTracks,
    JoinedDives,
    flown,
    reckoning,
)
from factory.exporting.og1.og1_terms import (
    ASCENT,
    DESCENT,
    INFLECTION,
    STILL_SPEED,
    SURFACE_DEPTH_M,
    SURFACING,
    TERMS,
    TRACKS,
    SimulatedMission,
    global_attributes,
    sensor_attributes,
    simulated_mission,
    simulated_terms,
)
from factory.exporting.og1.variables import (
    ENDING,
    Og1Variable,
    Variables,
    deployment,
    quality,
    variable,
    write_og1,
)
from factory.generation.generated_store import GeneratedStore, StoredFlight
from twin.errors import StoreError
from twin.geodesy import from_tangent_plane
from twin.logs.track import place_of
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

PLACES = ("true", "measured_onboard", "measured_gps")
"""Signals in metres from the origin, which the file holds as latitude and longitude."""


def export_og1(
    run: GeneratedStore | StoredFlight,
    mission: int,
    folder: Path,
    *,
    vehicle: str | None = None,
    metadata: Metadata | None = None,
) -> Path:
    """Write one mission into `folder`, under the name that the format prescribes.

    Args:
      run: the store.
      mission: row of the store.
      folder: for the file.
      vehicle: file or name of the vehicle whose flight model reckons the track; default the
        mission's own.
      metadata: facts on the mission that the store lacks.

    Raises:
      StoreError: no such mission, or its data cannot be read.
    """
    run.check_mission(mission)
    missing = [name for name in _needed(run.signals()) if name not in run.dataset]
    if missing:
        raise StoreError(f"store {run.path} lacks {', '.join(missing)}: OG1.0 needs them")
    facts = simulated_mission(run, mission)
    found = flown(run, [mission], vehicle)
    identity = global_attributes(facts, mission, metadata or Metadata())
    identity["flight_model"] = found.model
    series = _series(run, mission, identity, facts, found.tracks[mission])
    return write_og1(folder, identity, series, int(run.samples[mission]))


def _needed(signals: Sequence[str]) -> list[str]:
    positions = ["measured_onboard_north", "measured_onboard_east", "measured_gps_north"]
    measured = [name for _, name, _ in simulated_terms(signals)]
    return [*positions, "measured_gps_east", "measured_depth", "measured_dvl_mode", *measured]


def _series(
    run: GeneratedStore | StoredFlight,
    mission: int,
    identity: Mapping[str, Any],
    facts: SimulatedMission,
    track: FlownTrack,
) -> Variables:
    samples = int(run.samples[mission])

    def row(name: str) -> Array:
        return run.row(name, mission)[:samples].astype(float)

    place, start = (facts.latitude, facts.longitude), facts.start.timestamp()

    def degrees(name: str) -> tuple[Array, Array]:
        return from_tangent_plane(row(f"{name}_north"), row(f"{name}_east"), *place)

    time = start + np.arange(samples) * run.period
    depth = np.maximum(row("measured_depth"), 0.0)  # valid_min is 0: the gauge's zero error
    yield variable("TRAJECTORY", str(identity["id"]).removesuffix("_delayed"))
    yield variable("WMO_IDENTIFIER", "none: simulation")
    yield variable("PLATFORM_MODEL", f"simulated {facts.vehicle} glider")
    yield variable("PLATFORM_SERIAL_NUMBER", f"sim{mission:06d}")
    yield variable("TIME", time)
    latitude, longitude = from_tangent_plane(track.position[:, 0], track.position[:, 1], *place)
    method = {
        "interpolation_methodology": f"{track.method} (simulated)",
        "ancillary_variables": "POSITION_SD DEAD_RECKONING",
    }
    yield variable("LONGITUDE", longitude, **method)
    yield variable("LATITUDE", latitude, **method)
    yield from reckoning(track.reckoned > 0, track.deviation)
    for word, values in zip(("latitude", "longitude"), degrees("measured_onboard"), strict=True):
        long_name = f"{word} by the simulated on-board dead reckoning"
        yield variable(f"{word.upper()}_ONBOARD", values, like=word, long_name=long_name)
    yield variable(
        "DEPTH",
        depth,
        long_name="depth below the surface by the simulated pressure transducer",
        comment="readings above the surface, by the zero error of the gauge, are 0 here; PRES "
        "keeps them",
    )
    gps_latitude, gps_longitude = degrees("measured_gps")
    yield variable("TIME_GPS", np.where(np.isfinite(gps_latitude), time, np.nan))
    yield variable("LONGITUDE_GPS", gps_longitude)
    yield variable("LATITUDE_GPS", gps_latitude)
    yield from deployment(start, *place)
    codes = phases(depth, row("true_velocity_down"))
    how = "depth and vertical speed of the simulation"
    yield variable("PHASE", codes, phase_calculation_method=how)
    terms = simulated_terms(run.signals())
    fitted = {sensor for _, _, sensor in terms}
    for name in TERMS["sensors"]:
        if name in fitted:  # no CTD in water of density alone
            yield variable(name, 0, like="sensor", **sensor_attributes(run, name))
    for name, stored, sensor in terms:
        yield _signal(name, row(stored), stored, **({"sensor": sensor} if sensor else {}))
    word = "what the DVL's velocity is relative to (simulated)"
    yield variable("DVL_MODE", row("measured_dvl_mode"), long_name=word)
    true_latitude, true_longitude = degrees("true")
    yield variable("TRUE_LONGITUDE", true_longitude, like="longitude", long_name="true longitude")
    yield variable("TRUE_LATITUDE", true_latitude, like="latitude", long_name="true latitude")
    written = {stored for _, stored, _ in terms} | {"measured_dvl_mode", "measured_depth"}
    places = {f"{one}_{axis}" for one in PLACES for axis in ("north", "east")}
    for stored in run.signals():  # truth, commands, signals of a user's sensors
        if stored not in written | places:
            yield _signal(stored.upper(), row(stored), stored)


def phases(depth: Array, velocity_down: Array) -> NDArray[np.int8]:
    """OG1.0 phase of each sample from depth [m] and vertical speed [m/s]."""
    phase = np.where(velocity_down > 0.0, DESCENT, ASCENT)
    phase = np.where(np.abs(velocity_down) < STILL_SPEED, INFLECTION, phase)
    return np.where(depth < SURFACE_DEPTH_M, SURFACING, phase).astype(np.int8)


def _signal(name: str, values: Array, stored: str, **more: str) -> tuple[str, Og1Variable]:
    known = VARIABLES[stored].attributes()
    known["long_name"] = f"{TERMS['long_names'].get(stored, known['long_name'])} (simulated)"
    return variable(name, values, like="signal", **{**known, **more})


def corrected_places(track: JoinedDives, found: FlownTracks) -> Variables:
    """Corrected track, its standard deviation and flags."""
    methods = ", ".join(dict.fromkeys(found.tracks[mission].method for mission in track.missions))
    latitude, longitude = _degrees(track, lambda mission: found.tracks[mission].position)
    reckoned = track.gather(lambda mission: found.tracks[mission].reckoned) > 0.0
    for name, values in (("LONGITUDE", longitude), ("LATITUDE", latitude)):
        beside = f"{name}{ENDING} POSITION_SD DEAD_RECKONING"
        yield variable(name, values, interpolation_methodology=methods, ancillary_variables=beside)
        yield quality(name, values, estimated=reckoned, good=~reckoned)
    yield from reckoning(reckoned, track.gather(lambda mission: found.tracks[mission].deviation))


def tracks(track: JoinedDives) -> Variables:
    """Latitudes and longitudes of tracks that the store has in metres from each row's start; a file
    of a whole deployment has no such origin."""
    for stored, ending, word in TRACKS:
        names = [f"{stored}_{axis}" for axis in ("north", "east")]
        if not all(name in track.logs for name in names):
            continue

        def metres(mission: int, names: list[str] = names) -> Array:
            return np.stack([track.logs.signal(name, mission) for name in names], axis=1)

        for axis, values in zip(("latitude", "longitude"), _degrees(track, metres), strict=True):
            name, described = ending.format(axis.upper()), f"{axis} {word}"
            yield variable(name, values, like=axis, long_name=described)


def gps_fixes(track: JoinedDives, time: Array) -> Variables:
    """Fixes at the ends of the dives, each with its own time at the nearest sample."""
    logs = track.logs
    places = np.full((3, len(time)), np.nan)
    for mission in track.missions:
        begin = logs.starts[mission]
        last = begin + float(logs.log_rows[mission].duration)
        for when, fix in zip((begin, last), logs.fixes(mission), strict=True):
            if np.isfinite([*fix, when]).all():
                places[:, int(np.argmin(np.abs(time - when)))] = when, *fix
    yield variable("TIME_GPS", places[0])
    yield variable("LONGITUDE_GPS", np.mod(places[2] + 180.0, 360.0) - 180.0)
    yield variable("LATITUDE_GPS", places[1])


def _degrees(track: JoinedDives, of: Callable[[int], Array]) -> tuple[Array, Array]:
    """Latitude and longitude [degree] of each dive's track in metres, (samples,) each."""
    latitude, longitude = track.gather(
        lambda m: np.stack(place_of(track.logs, m).degrees(*of(m).T), axis=1)
    ).T
    return latitude, longitude
