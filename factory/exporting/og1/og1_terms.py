"""OG1.0 terms: vocabularies, names and global attributes of the format.

`SimulatedMission` holds the identity, place and date of a mission of a simulated store.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from factory.exporting.metadata import Metadata, with_metadata
from factory.generation.generated_store import GeneratedStore, StoredFlight
from factory.sampling.conditions import mission_place
from twin.bounded import file_names
from twin.errors import StoreError
from twin.records.attributes import made_at
from twin.records.coordinates import (
    NOMINAL,
    START_LATITUDE,
    START_LONGITUDE,
    START_TIME,
    read_place,
)
from twin.records.logged import LogStore
from twin.records.schema import MISSION, SIMULATED
from twin.records.trajectory import actuator_names
from twin.sensors import SensorSuite
from twin.version import __version__
from twin.water.current.axes import DEFAULT_TIME, Origin

EARLIEST = datetime.datetime(2001, 9, 9, 1, 46, 40, tzinfo=datetime.UTC)
"""Earliest time of OG1.0 (its valid_min), 1e9 s after 1970."""


@dataclass(frozen=True, kw_only=True)
class SimulatedMission:
    """Identity, place and date of a mission of `factory generate` or `twin simulate`."""

    name: str
    """Identifier of the mission, without spaces."""
    said: str
    """Sentence on the mission; for a single flight, it says if place or date is nominal."""
    vehicle: str
    latitude: float
    """[degree] Latitude of the origin."""
    longitude: float
    """[degree] Longitude of the origin."""
    start: datetime.datetime
    """Start in UTC."""
    duration: float
    """[s] Duration."""
    source: str
    """Program and vehicle that made the data."""
    history: str


def simulated_mission(run: GeneratedStore | StoredFlight, mission: int) -> SimulatedMission:
    """Identity, place and date of a mission of a store.

    Raises:
      StoreError: the date is earlier than the format allows.
    """
    latitude, longitude, start, nominal = _began(run, mission)
    if isinstance(run, StoredFlight):
        plan, vehicle = (str(run.attributes[name]) for name in ("mission", "vehicle"))
        verb = "are" if " and " in nominal else "is"
        name = f"{plan.replace(' ', '_')}_mission{mission}"
        said = f"Mission {plan!r}{f'; its {nominal} {verb} nominal' if nominal else ''}."
        duration = (int(run.samples[mission]) - 1) * run.period
        program, history = "glider-twin", f"{run.path.name}: twin.simulate"
    else:
        preset, vehicle = (str(run.settings[name]) for name in ("preset", "vehicle"))
        name = f"{preset}_seed{run.seed}_mission{mission}"
        said = f"Preset {preset}, seed {run.seed}, mission {mission}, split {run.splits[mission]}."
        duration = float(run.array("duration")[mission])
        program, history = f"glider-twin {__version__}", str(run.history)
    return SimulatedMission(
        name=name, said=said, vehicle=vehicle, latitude=latitude, longitude=longitude, start=start,
        duration=duration, source=f"simulation: {program}, vehicle {vehicle}", history=history,
    )  # fmt: skip


def _began(
    run: GeneratedStore | StoredFlight, mission: int
) -> tuple[float, float, datetime.datetime, str]:
    """Latitude, longitude [degree], start in UTC, and what is nominal: "place", "date", both or "".

    Stores of earlier versions may lack place and date. Stores of the factory then have them among
    the mission's parameters; a single flight gets the defaults of this version.
    """
    place, default = read_place(run.dataset.isel({MISSION: mission})), Origin()
    if not place and isinstance(run, GeneratedStore):
        place = mission_place(run.parameters(mission), run.given_current)
    lacking = [
        word
        for word, name in (("place", START_LATITUDE), ("date", START_TIME))
        if name not in place
    ]
    nominal = str(place.get(NOMINAL, " and ".join(lacking)))
    date = str(place.get(START_TIME, DEFAULT_TIME))
    start = datetime.datetime.fromisoformat(date).replace(tzinfo=datetime.UTC)
    if start < EARLIEST:
        raise StoreError(
            f"mission {mission} of {run.path} begins at {date}: OG1.0 has no dates "
            f"before {EARLIEST:%Y-%m-%d}; fly it at a later start time"
        )
    latitude = float(place.get(START_LATITUDE, default.latitude_deg))
    return latitude, float(place.get(START_LONGITUDE, default.longitude_deg)), start, nominal


Array = NDArray[np.float64]

N_MEASUREMENTS = "N_MEASUREMENTS"
TERMS: dict[str, Any] = yaml.safe_load(
    Path(__file__).with_name("og1.yaml").read_text(encoding="utf-8")
)
"""Variables and attributes of the format (see the file)."""
COORDINATES = "TIME LONGITUDE LATITUDE DEPTH"
ASCENT, DESCENT, SURFACING, INFLECTION = 1, 2, 3, 5
"""Codes of the format's phase vocabulary."""
SURFACE_DEPTH_M = 1.5
"""[m] Depth above which the glider counts as at the surface: half a hull and some."""
STILL_SPEED = 0.03
"""[m/s] Vertical speed below which a glider under water is turning."""

Term = tuple[str, str, str]
"""Name in the file, name in the store, sensor variable."""


def _measured(part: str) -> tuple[Term, ...]:
    return tuple((name, stored, sensor) for name, (stored, sensor) in TERMS[part].items())


SIMULATED_MEASURED, CTD_MEASURED = _measured("measured"), _measured("ctd")
MEASURED = (*SIMULATED_MEASURED, *CTD_MEASURED, ("RUDDER", "measured_fin", ""))


def simulated_terms(signals: Sequence[str]) -> list[Term]:
    """Terms of a store of simulated missions, by the parts that its vehicle has.

    Args:
      signals: names of all signals in the store.
    """
    parts = actuator_names(signals)
    gliders = {f"measured_{name}" for name in actuator_names(SIMULATED)}
    own = {f"measured_{name}" for name in parts}
    terms = [term for term in SIMULATED_MEASURED if term[1] not in gliders - own]
    ctd = (*CTD_MEASURED, ("CNDC", "measured_conductivity", "SENSOR_CTD"))
    terms += [term for term in ctd if term[1] in signals]
    named = {stored for _, stored, _ in terms}
    return terms + [(name.upper(), name, "") for name in sorted(own - named)]


TRACKS = (
    ("measured_onboard", "{}_ONBOARD", "by the vehicle's own dead reckoning"),
    ("commanded_waypoint", "WAYPOINT_{}", "of the waypoint that the vehicle was sent to"),
    ("true", "TRUE_{}", "where the simulated vehicle really was"),
)
"""Stores' signals `..._north` and `..._east` [m], and their names as latitude and longitude."""
RAW_TIMES = {
    "measured_depth_time": "TIME_DEPTH",
    "measured_attitude_time": "TIME_ATTITUDE",
    "measured_ctd_time": "TIME_CTD",
}
"""Times of the original samples, besides those of the grid."""
VARIATION = "MAGNETIC_VARIATION"
NOT_LOGGED: str = TERMS["logged"]["institution"]
"""Value of attributes that the format demands and a vehicle's log lacks."""


def sensor_attributes(run: GeneratedStore | StoredFlight, name: str) -> dict[str, str]:
    """Attributes of a sensor variable; a device without errors has no model name."""
    device, kind, model = TERMS["sensors"][name]
    settings = getattr(run.suite, device)
    called = f"simulated {model}"
    if not getattr(settings, "fitted", True):
        called = f"none: this vehicle has no {kind}"
    elif settings == getattr(SensorSuite.preset("ideal"), device):
        called = f"simulated ideal {kind}"
    return {
        "long_name": called,
        "sensor_model": called,
        "sensor_maker": "none: simulation",
        "sensor_serial_number": "n/a",
        "comment": "simulated",
    }


def stamp(moment: datetime.datetime) -> str:
    """Write a moment as the format does."""
    return moment.strftime("%Y%m%dT%H%M%S")


def bounds(latitude: Array, longitude: Array, depth: Array) -> dict[str, float | str]:
    """ACDD's limits of the data, which search engines of data portals read."""
    limits: dict[str, float | str] = {"geospatial_vertical_positive": "down"}
    for name, values, units in (
        ("lat", latitude, "degrees_north"),
        ("lon", longitude, "degrees_east"),
        ("vertical", depth, "m"),
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


def global_attributes(facts: SimulatedMission, mission: int, metadata: Metadata) -> dict[str, Any]:
    """Global attributes of a mission's file; `bounds` gives those that depend on the data."""
    serial = f"sim{mission:06d}"
    start = stamp(facts.start)
    end = facts.start + datetime.timedelta(seconds=facts.duration)
    own = {
        **_identity(serial, start, facts.name),
        **TERMS["simulated"],
        "time_coverage_end": stamp(end),
        "comment": f"SIMULATED DATA. {facts.said} LATITUDE and LONGITUDE are dead-reckoned as "
        "interpolation_methodology says, TRUE_* variables what really happened in the simulation.",
        "source": facts.source,
        "history": facts.history,
    }
    own["keywords"] = f"simulation, {own['keywords']}"
    return with_metadata(own, metadata, simulated=True)


def _identity(serial: str, start: str, deployment: str) -> dict[str, Any]:
    """Attributes that every file has."""
    return {
        **TERMS["global"],
        "id": f"{serial}_{start}_delayed",
        "internal_mission_identifier": deployment,
        "time_coverage_start": start,
        "start_date": start,
        "date_created": stamp(made_at()),
    }


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
    source = f"logs of a vehicle ({logs.source}: {logs.files}), read by glider-twin {__version__}"
    own = {
        **_identity(serial, start, deployment),
        **TERMS["logged"],
        "title": f"{kind} trajectory file, deployment {deployment}",
        "summary": f"{len(missions)} dives of deployment {deployment}, {logs.platform}.",
        "time_coverage_end": end,
        "source": source,
        "history": logs.history,
    }
    return with_metadata(own, metadata, simulated=logs.simulated)
