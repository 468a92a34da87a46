"""Flight terms: what a flight model adds to a logged deployment's OG1.0 file.

The names of the vertical and horizontal speeds and of the vertical current are those that
converters of Seaglider files use (OG1.0 leaves them free).

Sea water: what an OG1.0 file holds that a store does not: conductivity, oxygen per mass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.flown_track import FlownTracks
from factory.exporting.og1.og1_terms import TERMS
from factory.exporting.og1.variables import Variables, quality, variable
from twin.records.logged import LogStore
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]


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


def reckoning(reckoned: NDArray[np.bool_], deviation: Array) -> Variables:
    """Which positions are fixes, and how sure all are."""
    yield variable("DEAD_RECKONING", reckoned.astype(float))
    yield variable("POSITION_SD", deviation)


def flight_terms(track: JoinedDives, found: FlownTracks) -> Variables:
    """Velocities and currents by the flight model; none without one."""
    if all(found.tracks[mission].dive is None for mission in track.missions):
        return

    def of(pick: Callable[[Any], Array]) -> Array:
        """Values of each dive, NaN where none was flown."""

        def one(mission: int) -> Array:
            dive = found.tracks[mission].dive
            count = int(track.logs.samples[mission])
            return np.full(count, np.nan) if dive is None else pick(dive)

        return track.gather(one)

    def speed(dive: Any) -> Array:
        return np.asarray(dive.motion.speed)

    def attack(dive: Any) -> Array:
        return np.where(speed(dive) > LEAST_SPEED, np.degrees(dive.motion.angle_of_attack), np.nan)

    yield variable("GLIDER_SPEED_MODEL", of(speed))
    yield variable("GLIDER_HORZ_VELO_MODEL", of(lambda dive: np.hypot(*dive.velocity.T)))
    yield variable("GLIDER_VERT_VELO_MODEL", of(lambda dive: -dive.sink_rate))
    yield variable("GLIDER_SURGE_MODEL", of(lambda dive: dive.motion.surge))
    yield variable("GLIDER_SWAY_MODEL", of(lambda dive: dive.motion.sway))
    yield variable("ANGLE_OF_ATTACK_MODEL", of(attack))
    yield variable("VERT_CURR_MODEL", of(lambda dive: dive.water_up))
    yield from _currents(track, found)


LEAST_SPEED = 0.05
"""[m/s] below which an angle of attack means nothing"""


def _currents(track: JoinedDives, found: FlownTracks) -> Variables:
    """The depth-averaged current of each dive by the flight model, at the samples of the dive."""
    for axis, name in (("north", "NORTH"), ("east", "EAST"), ("deviation", "SD")):

        def of(mission: int, axis: str = axis) -> Array:
            values = np.full(int(track.logs.samples[mission]), np.nan)
            for current in found.tracks[mission].currents:
                values[current.first : current.last + 1] = getattr(current, axis)
            return values

        yield variable(f"DAC_{name}_MODEL", track.gather(of))


MS_PER_CM = 10.0
"""gsw gives conductivity in mS/cm; 1 S/m is 10 of them."""
MADE_CONDUCTIVITY: str = TERMS["variables"]["CNDC"]["long_name"]
LITRES = 1e3
"""in 1 m3"""
OXYGEN = "measured_oxygen"
PER_MASS = "moles_of_oxygen_per_unit_mass_in_sea_water"
WATER = ("measured_salinity", "measured_temperature", "measured_pressure")


def conductivity(track: JoinedDives) -> Variables:
    """What the CTD measured [S/m], from salinity, temperature and pressure; none without them."""
    if not set(WATER) <= set(track.logs.signals()):
        return
    import gsw

    values = np.asarray(gsw.C_from_SP(*(track.signal(name) for name in WATER))) / MS_PER_CM
    yield quality("CNDC", values)
    yield variable("CNDC", values)


def payload(track: JoinedDives) -> Variables:
    """Oxygen, chlorophyll ... under the names that the format has for them.

    Oxygen is per mass there, which needs the water's density: without a CTD it keeps its name and
    unit of the store.
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
    """[kg m-3] at 0 dbar, as Argo turns umol/L into umol/kg; straight on across holes of the CTD.

    Args:
      practical: salinity, PSS-78, (samples,).
      temperature: in situ [degree_Celsius], (samples,).
      pressure: [dbar], (samples,).
    """
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
