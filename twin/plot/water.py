"""Water: temperature and salinity of a mission, for the figures that show them."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.records.logged_trajectory import source_of
from twin.records.place import START_LATITUDE, START_LONGITUDE
from twin.records.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Water:
    """What the water was along the way, each (time,), NaN where it is not known."""

    temperature: Array
    """[degree_Celsius] in situ"""
    salinity: Array
    """practical"""
    words: dict[str, str]
    """What temperature and salinity are: true, measured, or corrected"""


def water_of(trajectory: Trajectory) -> Water:
    """The temperature and salinity of a mission: the true ones, or those of its CTD.

    Raises:
      InputError: it has neither.
    """
    for kind, default in (("true", "true"), ("measured", "measured")):
        names = [f"{kind}_{quantity}" for quantity in ("temperature", "salinity")]
        there = [trajectory.signals.get(name) for name in names]
        if all(values is not None and np.isfinite(values).any() for values in there):
            temperature, salinity = (np.asarray(values, float) for values in there)
            words = {
                name.removeprefix(f"{kind}_"): source_of(trajectory, name, default)
                for name in names
            }
            return Water(temperature=temperature, salinity=salinity, words=words)
    raise InputError(
        "this mission has no temperature and salinity: a log has them from its CTD, a simulated "
        "mission in water that has both (`--density` names such water)"
    )


def absolute(trajectory: Trajectory, water: Water) -> tuple[Array, Array, str]:
    """Absolute salinity [g/kg] and conservative temperature [degree_Celsius], TEOS-10, and the
    salinity's name; without a place on Earth it is the reference salinity, of standard seawater.
    """
    import gsw

    depth = trajectory["true_depth" if "true_depth" in trajectory else "measured_depth"]
    about = trajectory.provenance
    known = START_LATITUDE in about
    latitude = float(about[START_LATITUDE]) if known else NOMINAL_LATITUDE
    longitude = float(about[START_LONGITUDE]) if known else 0.0
    pressure = np.maximum(np.asarray(gsw.p_from_z(-np.maximum(depth, 0.0), latitude)), 0.0)
    if known:
        salinity = np.asarray(gsw.SA_from_SP(water.salinity, pressure, longitude, latitude))
    else:
        salinity = np.asarray(gsw.SR_from_SP(water.salinity))
    conservative = np.asarray(gsw.CT_from_t(salinity, water.temperature, pressure))
    return salinity, conservative, "absolute salinity" if known else "reference salinity"


NOMINAL_LATITUDE = 45.0
"""[degree] for the pressure of a mission without a place"""
