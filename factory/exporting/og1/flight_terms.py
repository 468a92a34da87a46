"""Flight terms: what a flight model adds to a logged deployment's OG1.0 file.

The names of the vertical and horizontal speeds and of the vertical current are those that
converters of Seaglider files use (OG1.0 leaves them free).

Sea water: what an OG1.0 file holds that a store does not: conductivity, oxygen per mass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.flown_track import FlownTracks
from factory.exporting.og1.og1_terms import COORDINATES, PAYLOAD, UNITS, VELOCITY
from factory.exporting.og1.variables import ENDING, Og1Variable, flags, quality
from twin.records.logged import LogStore
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

MODELLED = {"coverage_content_type": "modelResult", "coordinates": COORDINATES}
DEAD_RECKONING = {0: "gps_fix", 1: "dead_reckoned"}


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


def reckoning(reckoned: NDArray[np.bool_], deviation: Array) -> Iterator[tuple[str, Og1Variable]]:
    """Which positions are fixes, and how sure all are."""
    yield (
        "DEAD_RECKONING",
        Og1Variable(
            reckoned.astype(float),
            {
                "long_name": "whether the position is dead-reckoned or a GPS fix",
                **flags(DEAD_RECKONING),
                "coordinates": COORDINATES,
            },
            fill=-1,
            kind="i1",
        ),
    )
    attributes = {
        "long_name": "standard deviation of the position, north and east each",
        "units": UNITS["POSITION_SD"],
        **MODELLED,
    }
    yield "POSITION_SD", Og1Variable(deviation, attributes, fill=np.nan, kind="f4")


def flight_terms(track: JoinedDives, found: FlownTracks) -> Iterator[tuple[str, Og1Variable]]:
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

    for name, values, long_name, standard in (
        ("GLIDER_SPEED_MODEL", of(speed), "speed through the water",
         "platform_speed_wrt_sea_water"),
        ("GLIDER_HORZ_VELO_MODEL", of(lambda dive: np.hypot(*dive.velocity.T)),
         "horizontal speed through the water", ""),
        ("GLIDER_VERT_VELO_MODEL", of(lambda dive: -dive.sink_rate),
         "vertical speed in still water, positive up", ""),
        ("GLIDER_SURGE_MODEL", of(lambda dive: dive.motion.surge),
         "velocity through the water, forward", ""),
        ("GLIDER_SWAY_MODEL", of(lambda dive: dive.motion.sway),
         "velocity through the water, starboard", ""),
        ("ANGLE_OF_ATTACK_MODEL",
         of(lambda dive: np.where(speed(dive) > LEAST_SPEED,
                                  np.degrees(dive.motion.angle_of_attack), np.nan)),
         "angle of attack", ""),
        ("VERT_CURR_MODEL", of(lambda dive: dive.water_up),
         "vertical velocity of the water, positive up: observed less modelled rise",
         "upward_sea_water_velocity"),
    ):  # fmt: skip
        attributes = {
            "long_name": f"{long_name}, by the flight model",
            "units": UNITS[name],
            **MODELLED,
        }
        if standard:
            attributes["standard_name"] = standard
        yield name, Og1Variable(values, attributes, fill=np.nan, kind="f4")
    yield from _currents(track, found)


LEAST_SPEED = 0.05
"""[m/s] below which an angle of attack means nothing"""


def _currents(track: JoinedDives, found: FlownTracks) -> Iterator[tuple[str, Og1Variable]]:
    """The depth-averaged current of each dive by the flight model, at the samples of the dive."""
    for axis, standard in (
        ("north", "northward_sea_water_velocity"),
        ("east", "eastward_sea_water_velocity"),
        ("deviation", ""),
    ):

        def of(mission: int, axis: str = axis) -> Array:
            values = np.full(int(track.logs.samples[mission]), np.nan)
            for current in found.tracks[mission].currents:
                values[current.first : current.last + 1] = getattr(current, axis)
            return values

        word = "standard deviation of it, each way" if axis == "deviation" else f"{axis}ward"
        attributes = {
            "long_name": f"depth-averaged current by the flight model and the fixes, {word}",
            "units": VELOCITY,
            "comment": "mean over the dive, from fix to fix",
            **MODELLED,
        }
        if standard:
            attributes["standard_name"] = standard
        name = "DAC_SD_MODEL" if axis == "deviation" else f"DAC_{axis.upper()}_MODEL"
        yield name, Og1Variable(track.gather(of), attributes, fill=np.nan, kind="f4")


MS_PER_CM = 10.0
"""gsw gives conductivity in mS/cm; 1 S/m is 10 of them."""
MADE_CONDUCTIVITY = "conductivity, from practical salinity, temperature and pressure"
LITRES = 1e3
"""in 1 m3"""
OXYGEN = "measured_oxygen"
PER_MASS = "moles_of_oxygen_per_unit_mass_in_sea_water"
WATER = ("measured_salinity", "measured_temperature", "measured_pressure")


def conductivity(track: JoinedDives) -> Iterator[tuple[str, Og1Variable]]:
    """What the CTD measured [S/m], from salinity, temperature and pressure; none without them."""
    if not set(WATER) <= set(track.logs.signals()):
        return
    import gsw

    values = np.asarray(gsw.C_from_SP(*(track.signal(name) for name in WATER))) / MS_PER_CM
    attributes = {
        "long_name": MADE_CONDUCTIVITY,
        "standard_name": "sea_water_electrical_conductivity",
        "units": UNITS["CNDC"],
        "coordinates": COORDINATES,
        "sensor": "SENSOR_CTD",
        "ancillary_variables": f"CNDC{ENDING}",
    }
    yield quality("CNDC", values)
    yield "CNDC", Og1Variable(values, attributes, fill=np.nan, kind="f4")


def payload(track: JoinedDives) -> Iterator[tuple[str, Og1Variable]]:
    """Oxygen, chlorophyll ... under the names that the format has for them.

    Oxygen is per mass there, which needs the water's density: without a CTD it keeps its name and
    unit of the store.
    """
    for stored, name in PAYLOAD.items():
        if stored not in track.logs:
            continue
        values, variable = track.signal(stored), VARIABLES[stored]
        attributes = {**variable.attributes(), "units": UNITS[name], "coordinates": COORDINATES}
        if stored == OXYGEN:
            if not set(WATER) <= set(track.logs.signals()) or variable.units != "umol L-1":
                name, attributes["units"] = stored.upper(), variable.units
            else:
                values = values * LITRES / potential_density(*(track.signal(n) for n in WATER))
                attributes["standard_name"] = PER_MASS
                attributes["comment"] = "umol L-1 by the potential density of the sample"
                del attributes["valid_min"], attributes["valid_max"]
        yield name, Og1Variable(values, attributes, fill=np.nan, kind="f4")


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
