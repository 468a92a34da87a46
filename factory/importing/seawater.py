"""Sea water: depth, salinity and density from pressure and CTD by TEOS-10."""

from __future__ import annotations

import dataclasses

import gsw
import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import clean, kelvin_to_celsius
from factory.importing.deployment_log import (
    Channel,
    DeploymentLog,
)
from factory.importing.tally import (
    Tally,
)
from twin.errors import InputError

Array = NDArray[np.float64]

_MS_PER_CM = 10.0
"""gsw takes conductivity in mS/cm; 1 S/m is 10 of them."""
_SWAPPED = 9.0
"""[S/m] No sea water conducts more: such a median is in mS/cm."""


_NONE, _DISTILLED = -0.01, 5e-4
"""[S/m] What a CTD says that is off or in the air, with its noise: less than any natural water
conducts. Below are sentinels of the conductivity alone."""


def depth_of(pressure: Array, latitude_deg: float) -> Array:
    """Depth [m], positive down, of sea pressure [dbar]."""
    return np.asarray(-gsw.z_from_p(pressure, latitude_deg), np.float64)


def pressure_of(depth: Array, latitude_deg: Array | float) -> Array:
    """Sea pressure [dbar] at a depth [m].

    TEOS-10 ends 5 m above the sea. Further up, where only a sensor's offset leads, the pressure
    falls on as it does there.
    """
    below = np.maximum(depth, -_HIGHEST)
    pressure = gsw.p_from_z(-below, latitude_deg)
    if np.any(depth < -_HIGHEST):
        pressure = pressure + (depth - below) * gsw.p_from_z(-1.0, latitude_deg)
    return np.asarray(pressure, np.float64)


_HIGHEST = 4.0
"""[m] above the sea"""


def siemens(conductivity: Array, subject: str, tally: Tally) -> Array:
    """Conductivity in S/m; mS/cm where S/m is native is converted, counted."""
    good = conductivity[np.isfinite(conductivity)]
    if good.size and np.median(good) > _SWAPPED:
        tally.add("repaired", subject, good.size, "was in mS/cm where S/m is native")
        return conductivity / _MS_PER_CM
    return conductivity


def salinity(conductivity: Array, temperature: Array, pressure: Array) -> Array:
    """Practical salinity from S/m, degC, dbar."""
    with np.errstate(invalid="ignore"):
        return np.asarray(gsw.SP_from_C(conductivity * _MS_PER_CM, temperature, pressure))


def density(
    practical: Array,
    temperature: Array,
    pressure: Array,
    latitude: Array | float,
    longitude: Array | float,
) -> Array:
    """In-situ density [kg m-3] from practical salinity, in-situ temperature [degC] and dbar."""
    with np.errstate(invalid="ignore"):
        absolute = gsw.SA_from_SP(practical, pressure, longitude, latitude)
        conservative = gsw.CT_from_t(absolute, temperature, pressure)
        return np.asarray(gsw.rho(absolute, conservative, pressure), np.float64)


def ctd_channels(
    time: Array,
    *,
    temperature: Array,
    pressure: Array,
    latitude: Array | float,
    longitude: Array | float,
    tally: Tally,
    conductivity: Array | None = None,
    practical: Array | None = None,
) -> dict[str, Channel]:
    """Temperature, salinity and density as clean channels.

    Samples where one of the sensors has no value, or an impossible one, are left out together; a
    CTD that is off or in the air, by its conductivity, has no temperature either. Where both are
    given, the practical salinity is taken, and the conductivity [S/m] tells only that. Places
    [degree] are one for all samples or one for each: where a log grows, those of a dive must not
    depend on later ones.
    """
    off = np.zeros(len(time), bool)
    if conductivity is not None:
        off |= (conductivity > _NONE) & (conductivity < _DISTILLED)
    if practical is not None:
        off |= (practical <= 0.0) & (temperature == 0.0)
    there = off & np.isfinite(temperature)
    tally.add("removed", "temperature", int(there.sum()), "the CTD is off or in the air")
    temperature = kelvin_to_celsius(np.where(off, np.nan, temperature), "temperature", tally)
    warm = clean("measured_temperature", time, temperature, tally, subject="temperature")
    if conductivity is not None and practical is None:
        conducts = clean("conductivity", time, conductivity, tally)
        both = np.intersect1d(warm.time, conducts.time)
        use = np.isin(time, both)
        values = salinity(conductivity[use], temperature[use], pressure[use])
    elif practical is not None:
        use = np.isin(time, warm.time)
        values = practical[use]
    else:
        return {"measured_temperature": warm}
    fresh = clean("measured_salinity", time[use], values, tally, subject="salinity")
    use = np.isin(time, fresh.time)
    north, east = (np.broadcast_to(one, np.shape(time))[use] for one in (latitude, longitude))
    values = density(fresh.values, temperature[use], pressure[use], north, east)
    dense = clean("measured_density", time[use], values, tally, subject="density")
    channels = {
        "measured_temperature": warm,
        "measured_salinity": fresh,
        "measured_density": dense,
    }
    return {name: channel for name, channel in channels.items() if len(channel)}


_EQUATOR = 0.0
"""[degree] Latitude for depth where a log has no position: 0.5 % of gravity's range."""


def with_depth(log: DeploymentLog, tally: Tally) -> DeploymentLog:
    """The log with depth by TEOS-10 from its pressure; from depth alone, pressure is computed.

    A log whose rows are no dives may have neither.

    Raises:
      InputError: it has neither.
    """
    latitude = float(np.median(log.fixes.latitude)) if len(log.fixes) else _EQUATOR
    track = log.channel("latitude")
    if not len(log.fixes) and len(track):
        latitude = float(np.median(track.values))
    pressure, depth = log.channel("measured_pressure"), log.channel("measured_depth")
    channels = dict(log.channels)
    if len(pressure):
        channels["measured_depth"] = Channel(pressure.time, depth_of(pressure.values, latitude))
    elif len(depth):
        channels["measured_pressure"] = Channel(depth.time, pressure_of(depth.values, latitude))
        tally.add("note", "measured_pressure", len(depth), "computed from the vehicle's depth")
    elif log.pieces is None:
        raise InputError(f"{log.deployment}: the log has neither pressure nor depth")
    return dataclasses.replace(log, channels=channels)
