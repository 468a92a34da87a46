"""Vehicle: what a store says of the vehicle whose missions it holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from learn.data.features import GLIDER_PARTS
from learn.data.logs import VEHICLE, is_real
from learn.data.missions import open_missions
from twin.errors import StoreError
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle


def nominal_vehicle(attributes: Mapping[str, Any], store: str | Path) -> Vehicle:
    """The vehicle as its file says, from the MJCF text in the store; else the shipped glider.

    Logs have no such file: the shipped vehicle that is nearest to them stands for it.
    """
    if is_real(attributes):
        return load_vehicle(VEHICLE)
    text = attributes.get("vehicle_mjcf")
    if text is None and "scenario" in attributes:  # a mission of `twin simulate`
        text = json.loads(str(attributes["scenario"]))["vehicle"]["mjcf"]
    if text is None:
        return load_vehicle("glider")
    return parse_vehicle(str(text), Path(store))


def parts_of(store: str | Path) -> dict[str, float | None]:
    """Parts of a store's vehicle, with what the mirror port to starboard makes of each.

    A glider's for a store that cannot be opened: what is wrong with it is said where it is read.
    """
    try:
        dataset = open_missions(store)
    except StoreError:
        return dict.fromkeys(GLIDER_PARTS)
    try:
        attributes = dict(dataset.attrs)
    finally:
        dataset.close()
    if is_real(attributes):
        return dict.fromkeys(GLIDER_PARTS)
    return {part.name: part.mirrored() for part in nominal_vehicle(attributes, store).parts}
