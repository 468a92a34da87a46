"""Flight estimate: speed, water velocity and track of a store's missions, by a flight model.

found = estimate_flight("real.zarr", vehicle="mine.xml")
found.summary().w_deviation
flight_dataset(found)["w_water"]
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from twin.identify.calibration import Array, Calibration, load_calibration
from twin.identify.logged_missions import check_channels, load_logs, start_vehicle
from twin.logs.corrected_track import (
    SMOOTHER,
    DiveCurrent,
    check_correction,
    corrected_tracks,
    currents,
    drift_of,
    linear_track,
)
from twin.logs.current_profile import CurrentProfile, current_profile
from twin.logs.flight_estimator import FlightEstimator, FlownDive, fly_dive, open_estimator, still
from twin.logs.flight_summary import FlightSummary, phase_duration, phase_speed, summarise
from twin.logs.thermal_lag import CtdSeries, ThermalLag, common_lag
from twin.logs.track import PHASE, Fixes, Place, SmoothedWay, fixes_of, places_of
from twin.records.attributes import DEPLOYMENT
from twin.records.logged import start_times
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath
from twin.vehicle.vehicle import Vehicle

CTD = ("measured_temperature", "measured_salinity", "measured_pressure", "measured_depth")


@dataclasses.dataclass(frozen=True, kw_only=True)
class MissionFlight:
    """Flight of one mission, with its track over ground."""

    dive: FlownDive
    place: Place
    fixes: Fixes
    position: Array
    """North, east [m] from the mission's origin, (time, 2)"""
    deviation: Array
    """[m] Standard deviation of the position, north and east each, (time,)"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flight:
    """Flights of the missions of a store, estimated with a flight model."""

    store: MissionStore
    calibration: Calibration
    estimator: str
    track: str
    """Correction of tracks at the fixes"""
    missions: tuple[MissionFlight, ...]
    currents: tuple[DiveCurrent, ...]
    """Currents of all dives between fixes, in the order of the missions"""
    lags: dict[str, ThermalLag]
    """Thermal lag of the CTD, for each deployment whose data show a lag"""
    flown: tuple[int, ...]
    """Missions whose velocity through the water the estimator found"""
    profiles: Mapping[int, CurrentProfile]
    """Currents against depth of dives with cells of a Doppler log, by index in `currents`"""

    def summary(self) -> FlightSummary:
        """Statistics of the water's vertical velocity over all missions."""
        return summarise([one.dive for one in self.missions])


def estimate_flight(
    store: str | StorePath,
    vehicle: str | Path | Vehicle | Calibration | None = None,
    *,
    missions: Sequence[int] | None = None,
    estimator: str | FlightEstimator = "flight",
    thermal_lag: bool = True,
    track: str = SMOOTHER,
    profiles: bool = False,
    advance: Callable[[], object] = lambda: None,
) -> Flight:
    """Estimate the flight of a store: velocities through the water, currents, corrected tracks.

    Args:
      store: path of a store of logs, or of simulated missions with sensors.
      vehicle: file that `twin identify` wrote, a shipped vehicle's name, or a calibration. Default:
        the shipped vehicle of the log's type, or a simulated store's own.
      missions: rows to estimate; default all.
      estimator: an estimator of the velocity through the water, or its name.
      track: correction at the fixes, `smoother` or `linear`.
      profiles: solve for currents against depth, where a store has cells of a Doppler log.
      thermal_lag: fit the CTD's thermal lag and correct it.
      advance: called after each mission.

    Raises:
      StoreError: no such store or mission, a missing channel, or no dive in any of them.
      VehicleError: no such vehicle, or one whose flight is not modelled.
      InputError: an unknown estimator or correction, or a log without the type of its
        glider.
    """
    check_correction(track)
    found = MissionStore(store)
    check_channels(found, "a flight")
    if isinstance(vehicle, Calibration):
        calibration = vehicle
    else:
        calibration = load_calibration(start_vehicle(store) if vehicle is None else vehicle)
    way = open_estimator(estimator) if isinstance(estimator, str) else estimator
    chosen = list(range(len(found))) if missions is None else list(missions)
    logs = {log.index: log for log in load_logs(store, chosen, task="a flight")}
    places = places_of(found, chosen)
    raw = {mission: _ctd(found, mission, places[mission]) for mission in chosen}
    deployments = _deployments(found)
    names: dict[str, list[int]] = {}
    for mission in chosen:
        names.setdefault(deployments[mission], []).append(mission)
    lags: dict[str, ThermalLag] = {}
    for name, own in names.items() if thermal_lag else ():
        lag = common_lag([ctd for mission in own if (ctd := raw[mission]) is not None])
        if lag is not None:
            lags[name] = lag
    dives: dict[int, FlownDive] = {}
    for mission in chosen:
        before = raw[mission]
        ctd = None if before is None else before.corrected(lags.get(deployments[mission]))
        dives[mission] = (
            fly_dive(found, logs[mission], calibration, way, before, ctd)
            if mission in logs
            else still(found, mission, ctd)
        )
        advance()
    fixes = {mission: fixes_of(found, mission) for mission in chosen}
    starts = start_times(found)
    dacs = {
        mission: currents(
            mission, dive.velocity, dive.depth, found.period, fixes[mission], float(starts[mission])
        )
        for mission, dive in dives.items()
        if mission in logs and dive.tells_current
    }
    tracks = _tracks(found, list(names.values()), dives, fixes, dacs, places, track, way)
    flown = [
        MissionFlight(
            dive=dives[mission],
            place=places[mission],
            fixes=fixes[mission],
            position=tracks[mission][0],
            deviation=tracks[mission][1],
        )
        for mission in chosen
    ]
    averaged = tuple(d for mission in chosen for d in dacs.get(mission, []))
    return Flight(
        store=found,
        calibration=calibration,
        estimator=way.kind,
        track=track,
        missions=tuple(flown),
        currents=averaged,
        lags=lags,
        flown=tuple(mission for mission in chosen if mission in logs),
        profiles={
            k: one
            for k, dac in enumerate(averaged if profiles else ())
            if (one := current_profile(found, dives[dac.mission], calibration, dac)) is not None
        },
    )


def _tracks(
    store: MissionStore,
    deployments: Sequence[Sequence[int]],
    dives: Mapping[int, FlownDive],
    fixes: Mapping[int, Fixes],
    dacs: Mapping[int, Sequence[DiveCurrent]],
    places: Mapping[int, Place],
    correction: str,
    estimator: FlightEstimator,
) -> dict[int, tuple[Array, Array]]:
    """Corrected track and its standard deviation, by mission.

    A mission that no model can fly is assumed to move with the water. Its track is corrected
    linearly, and the smoother's parameters are fitted without it.
    """
    tracks: dict[int, tuple[Array, Array]] = {}
    starts = start_times(store)
    records, rows, latitudes = [], [], []
    for own in deployments:
        flown = [m for m in own if dives[m].motion is not None and correction == SMOOTHER]
        if len(flown) < len(own):
            every = [d for m in own for d in dacs.get(m, [])]
            drift = drift_of(sorted(every, key=lambda one: (one.start, one.mission)))
            for m in sorted({*own} - {*flown}):
                tracks[m] = linear_track(dives[m].velocity, store.period, fixes[m], drift)
        if not flown:
            continue
        modelled = [dives[m] for m in flown] if estimator.modelled else []
        speed = phase_speed(modelled, store.period)
        records.append(
            [
                SmoothedWay(
                    velocity=speed.scaled(dives[m]),
                    fixes=fixes[m],
                    start=float(starts[m]),
                    phase=phase_duration(dives[m], store.period) or PHASE,
                )
                for m in flown
            ]
        )
        rows.append(flown)
        latitudes.append(float(np.median([places[m].latitude for m in flown])))
    smoothed = corrected_tracks(records, store.period, latitudes)
    for flown, answers in zip(rows, smoothed, strict=True):
        tracks |= dict(zip(flown, answers, strict=True))
    return tracks


def _deployments(store: MissionStore) -> list[str]:
    """Name of each mission's deployment; each simulated mission is a deployment of its own."""
    if DEPLOYMENT in store:
        return [str(name) for name in store.array(DEPLOYMENT)]
    return [f"mission {mission}" for mission in range(len(store))]


def _ctd(store: MissionStore, mission: int, place: Place) -> CtdSeries | None:
    """CTD of a mission as stored; None without one."""
    if any(name not in store for name in CTD):
        return None
    count = int(store.samples[mission])
    temperature, salinity, pressure, depth = (
        store.row(name, mission)[:count].astype(float) for name in CTD
    )
    ctd = CtdSeries(
        period=store.period,
        depth=depth,
        pressure=pressure,
        temperature=temperature,
        salinity=salinity,
        latitude=place.latitude if np.isfinite(place.latitude) else NOMINAL_LATITUDE,
        longitude=place.longitude if np.isfinite(place.longitude) else 0.0,
    )
    return ctd if ctd.known.any() else None


NOMINAL_LATITUDE = 45.0
"""[degree] Latitude for the density of logs without a position; the error is 0.005 kg/m3"""
