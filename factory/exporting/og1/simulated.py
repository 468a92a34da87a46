"""Simulated mission: what an OG1.0 file says of it beside its signals, whichever store it is in."""

from __future__ import annotations

import datetime
from dataclasses import dataclass

from factory.stores.generated import GeneratedStore
from factory.stores.stored_flight import StoredFlight
from twin.errors import StoreError
from twin.records.place import START_LATITUDE, START_LONGITUDE, START_TIME
from twin.version import __version__
from twin.water.current.origin import Origin

NOMINAL_DEPLOYMENT = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
"""Start of missions without a date: OG1.0 needs one"""
EARLIEST = datetime.datetime(2001, 9, 9, 1, 46, 40, tzinfo=datetime.UTC)
"""OG1.0's valid_min of times, 1e9 s after 1970"""


@dataclass(frozen=True, kw_only=True)
class SimulatedMission:
    """Identity, place and date of one simulated mission."""

    name: str
    """Which mission of what, without spaces"""
    said: str
    """The same in words, and which of place and date are nominal"""
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
    origin = Origin(latitude_deg=run.parameters(mission).number("water.latitude"))
    return SimulatedMission(
        name=f"{preset}_seed{seed}_mission{mission}",
        said=f"Preset {preset}, seed {seed}, mission {mission}, split {run.splits[mission]}; the "
        "date is nominal.",
        vehicle=vehicle,
        latitude=origin.latitude_deg,
        longitude=origin.longitude_deg,
        start=NOMINAL_DEPLOYMENT,
        duration=float(run.array("duration")[mission]),
        source=f"simulation: glider-twin {__version__}, vehicle {vehicle}",
        history=str(run.history),
    )


def _flight(run: StoredFlight, mission: int) -> SimulatedMission:
    place, default = run.place(mission), Origin()
    start = NOMINAL_DEPLOYMENT
    if START_TIME in place:
        start = datetime.datetime.fromisoformat(str(place[START_TIME]))
        start = start.replace(tzinfo=datetime.UTC)
    if start < EARLIEST:
        raise StoreError(
            f"mission {mission} of {run.path} begins at {place[START_TIME]}: OG1.0 has no dates "
            f"before {EARLIEST:%Y-%m-%d}; fly it at a later start time"
        )
    nominal = [
        word
        for word, name in (("place", START_LATITUDE), ("date", START_TIME))
        if name not in place
    ]
    words = f"; its {' and '.join(nominal)} {'is' if len(nominal) == 1 else 'are'} nominal"
    plan, vehicle = str(run.attributes["mission"]), str(run.attributes["vehicle"])
    samples = int(run.samples[mission])
    return SimulatedMission(
        name=f"{plan.replace(' ', '_')}_mission{mission}",
        said=f"Mission {plan!r}{words if nominal else ''}.",
        vehicle=vehicle,
        latitude=float(place.get(START_LATITUDE, default.latitude_deg)),
        longitude=float(place.get(START_LONGITUDE, default.longitude_deg)),
        start=start,
        duration=(samples - 1) * run.period,
        source=f"simulation: glider-twin, vehicle {vehicle}",
        history=f"{run.path.name}: twin.simulate",
    )
