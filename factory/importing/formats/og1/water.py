"""Water: temperature, salinity, density and oxygen of an OG1.0 file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.seawater import LITRES, potential_density
from factory.importing.formats.og1.names import CONDUCTIVITIES, SALINITIES, TEMPERATURES
from factory.importing.reading.deployment_log import EMPTY, Channel, Fixes
from factory.importing.reading.tally import Tally
from factory.importing.reading.unread_names import leave_out
from factory.importing.repairs.seawater import ctd_channels, siemens

Array = NDArray[np.float64]


def ctd(
    time: Array,
    columns: Mapping[str, Array],
    channels: Mapping[str, Channel],
    fixes: Fixes,
    tally: Tally,
    *,
    own_conductivity: bool,
) -> tuple[dict[str, Channel], set[str]]:
    """Temperature, salinity and density, and the names that they come from.

    With `own_conductivity` also the conductivity, which was measured and not made of the others.
    """

    def first(names: Sequence[str]) -> Array | None:
        found = next((n for n in names if n in columns and np.isfinite(columns[n]).any()), None)
        used.update([found] if found else [])
        return columns[found] if found else None

    used: set[str] = set()
    at = channels.get("measured_pressure") or channels.get("measured_depth") or EMPTY
    temperature = first(TEMPERATURES) if len(at) else None
    if temperature is None:
        return {}, used
    practical = first(SALINITIES)
    measured = first(CONDUCTIVITIES) if practical is None or own_conductivity else None
    if measured is not None:
        measured = siemens(measured, "CNDC", tally)
    conductivity = measured if practical is None else None
    latitude, longitude = columns.get("LATITUDE"), columns.get("LONGITUDE")
    place = (0.0, 0.0)
    if len(fixes):
        place = float(np.median(fixes.latitude)), float(np.median(fixes.longitude))
    elif latitude is not None and longitude is not None and np.isfinite(latitude).any():
        place = float(np.nanmedian(latitude)), float(np.nanmedian(longitude))
    water = ctd_channels(
        time,
        temperature=temperature,
        pressure=at.at(time),
        practical=practical,
        conductivity=conductivity,
        latitude=place[0],
        longitude=place[1],
        tally=tally,
    )
    if measured is not None and own_conductivity:
        there = np.isfinite(measured)
        water["measured_conductivity"] = Channel(time[there], measured[there])
    return water, used


def oxygen_per_volume(
    oxygen: Channel,
    attributes: Mapping[str, Any],
    name: str,
    water: Mapping[str, Channel],
    pressure: Channel,
    tally: Tally,
) -> Channel:
    """Dissolved oxygen [umol L-1]; per mass it is turned by the potential density of the sample.

    Without salinity and temperature nobody knows it per volume: left out, and told.
    """
    units = str(attributes.get("units", "")).lower().replace("_per_", "/")
    if not any(word in units for word in ("kg", "kilogram")):
        return oxygen
    known = [water.get(n, EMPTY) for n in ("measured_salinity", "measured_temperature")]
    if not all(len(one) for one in known) or not len(pressure):
        leave_out([name], "per mass of water, without salinity and temperature beside it", tally)
        return EMPTY
    dense = potential_density(*(one.at(oxygen.time) for one in (*known, pressure)))
    tally.add("note", name, len(oxygen), "umol/kg, kept as umol/L by its potential density")
    return Channel(oxygen.time, oxygen.values * dense / LITRES)
