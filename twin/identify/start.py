"""Start: the shipped vehicle that identification starts from, by the kind of the log."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from twin.errors import InputError
from twin.identify.logged import check_channels
from twin.records.attributes import PLATFORM, SOURCE_FORMAT
from twin.records.reader import MissionStore
from twin.records.store_path import StorePath
from twin.vehicle.shipped import vehicle_names
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle

SHALLOW_SLOCUM = {"measured_depth": 230.0, "measured_pump": 245.0}
"""[m], [cm3] beyond which a 200 m Slocum with its ballast pump does not go; deep ones have an oil
pump of 260 cm3 either way."""
KINDS = ("seaglider", "seaexplorer", "spray", "slocum")
"""Kinds of glider, as formats and platforms of logs call them."""


def start_vehicle(store: str | StorePath) -> Vehicle:
    """The vehicle file that suits a store: a simulated one's own, else that of the log's kind.

    Raises:
      StoreError: no such store, or a log of an unknown kind that no flight model can read.
      InputError: the log does not say which kind of glider it is of.
    """
    with MissionStore(store) as found:
        if not found.logged:
            flown = found.vehicle
            return parse_vehicle(flown.xml, flown.path)
        kind = _kind(found)
        if kind is None:
            check_channels(found, "a flight model")  # no --vehicle helps a log without them
            said = [str(found.attributes.get(name, "")) for name in (SOURCE_FORMAT, PLATFORM)]
            raise InputError(
                f"store {store} does not say which glider it is of "
                f"(source_format {said[0]!r}, platform {said[1]!r}); give --vehicle, such as "
                f"{', '.join(KINDS[:2])} or slocum-200"
            )
        return load_vehicle(_slocum(found) if kind == "slocum" else kind)


def other_kind(store: str | StorePath, vehicle: Vehicle) -> str:
    """A warning if a vehicle is of another kind than the log, both as they say; empty if not.

    A vehicle made from a shipped file still has its model's name; of other names nothing is known.

    Raises:
      StoreError: no such store.
    """
    with MissionStore(store) as found:
        kind = _kind(found) if found.logged else None
    model = ElementTree.fromstring(vehicle.xml).get("model", "")
    if kind is None or model not in vehicle_names() or kind in model:
        return ""
    return (
        f"vehicle {vehicle.name} ({model}) is of another kind than that of the log {store} "
        f"({kind}): it did not fly these dives; give --vehicle of the log's kind"
    )


def _kind(store: MissionStore) -> str | None:
    """Of the glider, as a log says; None where it does not."""
    said = [str(store.attributes.get(name, "")) for name in (SOURCE_FORMAT, PLATFORM)]
    return next((k for text in said for k in KINDS if k in text.lower()), None)


def _slocum(store: MissionStore) -> str:
    """The shallow one with a ballast pump, or the deep one with an oil pump."""
    largest = 0.0
    for name, limit in SHALLOW_SLOCUM.items():
        if name in store:
            values = np.abs(store.rows(name, range(len(store))))
            known = values[np.isfinite(values)]
            if known.size:
                largest = max(largest, float(np.percentile(known, 99.5)) / limit)
    return "slocum-1000" if largest > 1.0 else "slocum-200"
