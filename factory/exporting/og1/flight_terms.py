"""Flight terms: variables that a flight model adds to a logged deployment's OG1.0 file.

The names of the vertical and horizontal speeds and of the vertical current are those that
converters of Seaglider files use (OG1.0 leaves them free).

Corrected tracks, velocities and currents are those of `twin.logs` if the vehicle's flight can be
modelled. Otherwise the vehicle's own dead-reckoned track is corrected at the fixes by the same
method. Without an own track, straight lines join the fixes; the file names method and reason.

Here are also conductivity and oxygen per mass: OG1.0 files hold them, and stores do not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.og1_terms import TERMS
from factory.exporting.og1.variables import Variables, quality, variable
from twin.errors import TwinError
from twin.logs import DiveCurrent, Drift, Fixes, corrected_track, estimate_flight, linear_track
from twin.logs.corrected_track import USUAL_CHANGE, USUAL_DURATION, track_velocity
from twin.logs.flight_estimator import FlownDive
from twin.logs.track import fixes_of, place_of
from twin.records.logged import LogStore
from twin.records.reader import MissionStore
from twin.records.schema import VARIABLES
from twin.vehicle.vehicle import Vehicle

BY_MODEL = "dead-reckoned by a flight model, smoothed with the current by all GPS fixes"
ON_BOARD = "on-board dead reckoning, smoothed with the current by the GPS fixes"
STRAIGHT = "straight line between GPS fixes"
UNKNOWN = "unknown: no GPS fix and no track"


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownTrack:
    """Track of one mission over ground."""

    position: Array
    """North, east [m] from the mission's origin, (time, 2)."""
    deviation: Array
    """[m] Standard deviation in each direction, (time,)."""
    fixes: Fixes
    method: str
    """Method that gave the track, for the file."""
    dive: FlownDive | None
    """Dive by the flight model; None without a model."""
    currents: tuple[DiveCurrent, ...]
    """Currents of the mission's dives."""
    reckoned: Array
    """Flag: 1 at each sample without a GPS fix, 0 at the fixes, (time,)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownTracks:
    """Tracks of the missions of a store."""

    tracks: dict[int, FlownTrack]
    model: str
    """Vehicle of the flight model, or the reason why there is none."""


def flown(
    run: MissionStore, missions: Sequence[int], vehicle: str | Vehicle | None = None
) -> FlownTracks:
    """Estimate the tracks of these missions.

    Args:
      run: the store.
      missions: rows of the store.
      vehicle: file or name of the vehicle, which must have a flight model; default as in
        `twin.logs.estimate_flight`.

    Raises:
      TwinError: the given vehicle cannot be flown on this store.
    """
    try:
        found = estimate_flight(run.path, vehicle, missions=missions)
    except TwinError as error:
        if vehicle is not None:
            raise
        reason = " ".join(str(error).split())
        tracks = {mission: _unmodelled(run, mission) for mission in missions}
        return FlownTracks(tracks=tracks, model=f"none: {reason}")
    tracks = {}
    for one in found.missions:
        mission = one.dive.mission
        if one.dive.motion is None:
            tracks[mission] = _unmodelled(run, mission)
            continue
        tracks[mission] = FlownTrack(
            position=one.position,
            deviation=one.deviation,
            fixes=one.fixes,
            method=BY_MODEL if len(one.fixes) else f"{BY_MODEL}; no fix",
            dive=one.dive,
            currents=tuple(c for c in found.currents if c.mission == mission),
            reckoned=_reckoned(run, mission),
        )
    return FlownTracks(
        tracks=tracks, model=f"flight model of vehicle {found.calibration.vehicle.name}"
    )


def _unmodelled(run: MissionStore, mission: int) -> FlownTrack:
    """Track from the vehicle's own track, or from straight lines between fixes."""
    fixes = fixes_of(run, mission)
    velocity, method = _on_board(run, mission, fixes), ON_BOARD
    if velocity is not None:
        latitude = place_of(run, mission).latitude
        position, deviation = corrected_track(velocity, run.period, fixes, latitude)
    else:
        velocity, method = np.zeros((int(run.samples[mission]), 2)), STRAIGHT
        usual = Drift(diffusivity=0.5 * USUAL_CHANGE**2 * USUAL_DURATION, change=USUAL_CHANGE)
        position, deviation = linear_track(velocity, run.period, fixes, usual)
        if not len(fixes):
            position[:], deviation[:], method = np.nan, np.nan, UNKNOWN
    return FlownTrack(
        position=position, deviation=deviation, fixes=fixes, method=method, dive=None, currents=(),
        reckoned=_reckoned(run, mission),
    )  # fmt: skip


def _reckoned(run: MissionStore, mission: int) -> Array:
    """Flag: 1 where no GPS fix was taken, (time,)."""
    count = int(run.samples[mission])
    if "measured_gps_north" not in run:
        return np.ones(count)
    return 1.0 - np.isfinite(run.row("measured_gps_north", mission)[:count])


def _on_board(run: MissionStore, mission: int, fixes: Fixes) -> Array | None:
    """North, east velocity [m/s] of the vehicle's own track, (time, 2); None without one."""
    names = ("measured_onboard_north", "measured_onboard_east")
    if any(name not in run for name in names):
        return None
    count = int(run.samples[mission])
    track = np.stack([run.row(name, mission)[:count].astype(float) for name in names], axis=1)
    return track_velocity(track, run.period, fixes)


Array = NDArray[np.float64]


@dataclass(frozen=True)
class JoinedDives:
    """Dives of one file on one time axis, which increases strictly."""

    logs: LogStore
    missions: tuple[int, ...]
    order: NDArray[np.intp]
    """Indices of the kept samples among those of all dives joined in order."""

    def gather(self, of: Callable[[int], Array]) -> Array:
        """Join the values of `of` for each dive into one array, (samples,)."""
        return np.concatenate([of(mission) for mission in self.missions])[self.order]

    def signal(self, name: str) -> Array:
        """Values of a stored signal, (samples,)."""
        return self.gather(lambda mission: self.logs.signal(name, mission))

    def repeated(self, name: str) -> Array:
        """Number of each dive, repeated at each of its samples, (samples,)."""
        values = self.logs.number(name)
        return self.gather(
            lambda mission: np.full(int(self.logs.samples[mission]), values[mission])
        )


def reckoning(reckoned: NDArray[np.bool_], deviation: Array) -> Variables:
    """Variables that mark dead-reckoned positions and give the standard deviation of all."""
    yield variable("DEAD_RECKONING", reckoned.astype(float))
    yield variable("POSITION_SD", deviation)


def flight_terms(track: JoinedDives, found: FlownTracks) -> Variables:
    """Velocities and currents by the flight model; no variables without one."""
    if all(found.tracks[mission].dive is None for mission in track.missions):
        return

    def of(pick: Callable[[Any], Array]) -> Array:
        """Values of each dive; NaN for a dive without a flight."""

        def one(mission: int) -> Array:
            dive = found.tracks[mission].dive
            count = int(track.logs.samples[mission])
            return np.full(count, np.nan) if dive is None else pick(dive)

        return track.gather(one)

    def speed(dive: Any) -> Array:
        return np.asarray(dive.motion.speed)

    def attack(dive: Any) -> Array:
        return np.where(speed(dive) > LEAST_SPEED, np.degrees(dive.motion.angle_of_attack), np.nan)

    def attack_deviation(dive: Any) -> Array:
        return np.where(speed(dive) > LEAST_SPEED, np.degrees(dive.attack_deviation), np.nan)

    yield variable("GLIDER_SPEED_MODEL", of(speed))
    yield variable("GLIDER_HORZ_VELO_MODEL", of(lambda dive: np.hypot(*dive.velocity.T)))
    yield variable("GLIDER_VERT_VELO_MODEL", of(lambda dive: -dive.sink_rate))
    yield variable("GLIDER_SURGE_MODEL", of(lambda dive: dive.motion.surge))
    yield variable("GLIDER_SWAY_MODEL", of(lambda dive: dive.motion.sway))
    yield variable("ANGLE_OF_ATTACK_MODEL", of(attack))
    yield variable("GLIDER_SPEED_SD_MODEL", of(lambda dive: dive.speed_deviation))
    yield variable("ANGLE_OF_ATTACK_SD_MODEL", of(attack_deviation))
    yield variable("VERT_CURR_MODEL", of(lambda dive: dive.water_up))
    yield from _currents(track, found)


LEAST_SPEED = 0.05
"""[m/s] Speed below which the angle of attack is noise and left out."""


def _currents(track: JoinedDives, found: FlownTracks) -> Variables:
    """Depth-averaged current of each dive by the flight model, at the samples of the dive."""
    for axis, name in (("north", "NORTH"), ("east", "EAST"), ("deviation", "SD")):

        def of(mission: int, axis: str = axis) -> Array:
            values = np.full(int(track.logs.samples[mission]), np.nan)
            for current in found.tracks[mission].currents:
                values[current.first : current.last + 1] = getattr(current, axis)
            return values

        yield variable(f"DAC_{name}_MODEL", track.gather(of))


MS_PER_CM = 10.0
"""[mS/cm] in 1 S/m; gsw gives conductivity in mS/cm."""
MADE_CONDUCTIVITY: str = TERMS["variables"]["CNDC"]["long_name"]
LITRES = 1e3
"""Litres in 1 m3."""
OXYGEN = "measured_oxygen"
PER_MASS = "moles_of_oxygen_per_unit_mass_in_sea_water"
WATER = ("measured_salinity", "measured_temperature", "measured_pressure")


def conductivity(track: JoinedDives) -> Variables:
    """Conductivity [S/m] from salinity, temperature and pressure; no variables without them."""
    if not set(WATER) <= set(track.logs.signals()):
        return
    import gsw

    values = np.asarray(gsw.C_from_SP(*(track.signal(name) for name in WATER))) / MS_PER_CM
    yield quality("CNDC", values)
    yield variable("CNDC", values)


def payload(track: JoinedDives) -> Variables:
    """Payload variables, such as oxygen and chlorophyll, under the format's names.

    The format has oxygen per mass, which needs the water's density. Without a CTD, oxygen keeps its
    name and unit of the store.
    """
    for stored, (name, units) in TERMS["payload"].items():
        if stored not in track.logs:
            continue
        values, own = track.signal(stored), VARIABLES[stored]
        attributes = {**own.attributes(), "units": units}
        if stored == OXYGEN:
            if not set(WATER) <= set(track.logs.signals()) or own.units != "umol L-1":
                name, attributes["units"] = stored.upper(), own.units
            else:
                values = values * LITRES / potential_density(*(track.signal(n) for n in WATER))
                attributes["standard_name"] = PER_MASS
                attributes["comment"] = "umol L-1 by the potential density of the sample"
                del attributes["valid_min"], attributes["valid_max"]
        yield variable(name, values, like="signal", **attributes)


def potential_density(practical: Array, temperature: Array, pressure: Array) -> Array:
    """[kg m-3] Density at 0 dbar, as Argo converts umol/L to umol/kg; linear across gaps."""
    import gsw

    # the place changes absolute salinity by less than 0.03 g/kg, oxygen by 0.003 %
    with np.errstate(invalid="ignore"):
        absolute = gsw.SR_from_SP(practical)
        conservative = gsw.CT_from_t(absolute, temperature, pressure)
        values = np.asarray(gsw.rho(absolute, conservative, 0.0), float)
    known = np.flatnonzero(np.isfinite(values))
    if not known.size:
        return values
    return np.interp(np.arange(len(values)), known, values[known])
