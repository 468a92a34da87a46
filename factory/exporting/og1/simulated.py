"""Simulated mission: what an OG1.0 file says of it beside its signals, whichever store it is in."""

from __future__ import annotations

import datetime
from dataclasses import dataclass

from factory.generation.generated_store import GeneratedStore, StoredFlight
from factory.sampling.conditions import mission_place
from twin.errors import StoreError
from twin.records.coordinates import (
    NOMINAL,
    START_LATITUDE,
    START_LONGITUDE,
    START_TIME,
    read_place,
)
from twin.records.schema import MISSION
from twin.version import __version__
from twin.water.current.axes import DEFAULT_TIME, Origin

EARLIEST = datetime.datetime(2001, 9, 9, 1, 46, 40, tzinfo=datetime.UTC)
"""OG1.0's valid_min of times, 1e9 s after 1970"""


@dataclass(frozen=True, kw_only=True)
class SimulatedMission:
    """Identity, place and date of one simulated mission."""

    name: str
    """Identifier of the mission, without spaces"""
    said: str
    """One sentence of the mission; it says which of place and date are nominal"""
    vehicle: str
    latitude: float
    """[degree] of the origin"""
    longitude: float
    """[degree] of the origin"""
    start: datetime.datetime
    """UTC"""
    duration: float
    """[s]"""
    source: str
    """What made it"""
    history: str


def simulated_mission(run: GeneratedStore | StoredFlight, mission: int) -> SimulatedMission:
    """Identity, place and date of a mission of a store.

    Raises:
      StoreError: its date is earlier than the format allows.
    """
    return _flight(run, mission) if isinstance(run, StoredFlight) else _of_factory(run, mission)


def _of_factory(run: GeneratedStore, mission: int) -> SimulatedMission:
    preset, seed, vehicle = run.settings["preset"], run.seed, str(run.settings["vehicle"])
    latitude, longitude, start, _ = _began(run, mission)
    return SimulatedMission(
        name=f"{preset}_seed{seed}_mission{mission}",
        said=f"Preset {preset}, seed {seed}, mission {mission}, split {run.splits[mission]}.",
        vehicle=vehicle,
        latitude=latitude,
        longitude=longitude,
        start=start,
        duration=float(run.array("duration")[mission]),
        source=f"simulation: glider-twin {__version__}, vehicle {vehicle}",
        history=str(run.history),
    )


def _flight(run: StoredFlight, mission: int) -> SimulatedMission:
    latitude, longitude, start, nominal = _began(run, mission)
    verb = "are" if " and " in nominal else "is"
    plan, vehicle = str(run.attributes["mission"]), str(run.attributes["vehicle"])
    samples = int(run.samples[mission])
    return SimulatedMission(
        name=f"{plan.replace(' ', '_')}_mission{mission}",
        said=f"Mission {plan!r}{f'; its {nominal} {verb} nominal' if nominal else ''}.",
        vehicle=vehicle,
        latitude=latitude,
        longitude=longitude,
        start=start,
        duration=(samples - 1) * run.period,
        source=f"simulation: glider-twin, vehicle {vehicle}",
        history=f"{run.path.name}: twin.simulate",
    )


def _began(
    run: GeneratedStore | StoredFlight, mission: int
) -> tuple[float, float, datetime.datetime, str]:
    """Latitude, longitude [degree], UTC, and which of place and date are nominal.

    Stores of earlier versions may not say it: those of the factory have the parameters, for single
    flights the defaults of today stand.
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
    said = str(place.get(START_TIME, DEFAULT_TIME))
    start = datetime.datetime.fromisoformat(said).replace(tzinfo=datetime.UTC)
    if start < EARLIEST:
        raise StoreError(
            f"mission {mission} of {run.path} begins at {said}: OG1.0 has no dates "
            f"before {EARLIEST:%Y-%m-%d}; fly it at a later start time"
        )
    latitude = float(place.get(START_LATITUDE, default.latitude_deg))
    return latitude, float(place.get(START_LONGITUDE, default.longitude_deg)), start, nominal
