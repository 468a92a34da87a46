"""Sea water: what an OG1.0 file holds that a store does not: conductivity, oxygen per mass."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.flight_terms import JoinedDives
from factory.exporting.og1.quality import ENDING, quality
from factory.exporting.og1.terms import COORDINATES, PAYLOAD
from factory.exporting.og1.variables import Og1Variable
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

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
        "units": "S m-1",
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
    for stored, (name, units) in PAYLOAD.items():
        if stored not in track.logs:
            continue
        values, variable = track.signal(stored), VARIABLES[stored]
        attributes = {**variable.attributes(), "units": units, "coordinates": COORDINATES}
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
