"""Place: where and when missions began on Earth, in a trajectory's provenance and in stores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.records.schema import MISSION

if TYPE_CHECKING:
    import xarray as xr

START_LATITUDE, START_LONGITUDE, START_TIME = "start_latitude", "start_longitude", "start_time"
"""Names in a trajectory's provenance, and of arrays (mission) in stores; of the frame's origin"""
PLACE = (START_LATITUDE, START_LONGITUDE, START_TIME)
_DEGREES = {
    START_LATITUDE: ("latitude", "degree_north"),
    START_LONGITUDE: ("longitude", "degree_east"),
}
_EPOCH = "seconds since 1970-01-01T00:00:00Z"


def place_arrays(provenances: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Arrays (mission) of the places and times that the trajectories know; none where none does.

    Args:
      provenances: of the trajectories, in their order.
    """
    arrays: dict[str, Any] = {}
    for name, (standard_name, units) in _DEGREES.items():
        if any(name in one for one in provenances):
            values = np.array([one.get(name, np.nan) for one in provenances], float)
            long_name = f"{standard_name} of the origin, where the mission began"
            attributes = {"units": units, "standard_name": standard_name, "long_name": long_name}
            arrays[name] = (MISSION, values, attributes)
    if any(START_TIME in one for one in provenances):
        moments = [np.datetime64(one.get(START_TIME, "NaT"), "ns") for one in provenances]
        seconds = (np.array(moments) - np.datetime64(0, "ns")) / np.timedelta64(1, "s")
        attributes = {"units": _EPOCH, "standard_name": "time", "long_name": "start, UTC"}
        arrays[START_TIME] = (MISSION, seconds, {**attributes, "calendar": "standard"})
    return arrays


def read_place(one: xr.Dataset) -> dict[str, float | str]:
    """What `place_arrays` wrote about one mission, as provenance; its times decoded or not."""
    place: dict[str, float | str] = {}
    for name in _DEGREES:
        if name in one and np.isfinite(value := float(one[name].values)):
            place[name] = value
    if START_TIME in one:
        start = np.asarray(one[START_TIME].values)
        if not np.issubdtype(start.dtype, np.datetime64):
            start = np.asarray(float(start) * 1e6).astype("datetime64[us]")
        if not np.isnat(start):
            place[START_TIME] = start.astype("datetime64[us]").item().isoformat()
    return place
