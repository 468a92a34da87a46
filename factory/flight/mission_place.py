"""Mission place: where and when a mission is flown, and the coordinates of its samples."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.recipe.sampling import Parameters
from twin.physics.scenario import SAMPLE_PERIOD
from twin.records.place import (
    START_LATITUDE,
    START_LONGITUDE,
    START_TIME,
    flown_coordinates,
)
from twin.records.trajectory import sample_times
from twin.water.current.base import Current
from twin.water.current.origin import DEFAULT_TIME, Origin

START_DAY = "mission.start_day"
EPOCH = datetime.datetime.fromisoformat(DEFAULT_TIME)
"""What days are counted from"""


def origin(parameters: Parameters) -> Origin:
    """Where and when the mission is, to the second."""
    days = datetime.timedelta(seconds=round(86400.0 * parameters.number(START_DAY)))
    return Origin(
        latitude_deg=parameters.number("water.latitude"),
        longitude_deg=parameters.number("water.longitude"),
        time=(EPOCH + days).isoformat(),
    )


def mission_place(parameters: Parameters, current: Current | None) -> dict[str, float | str]:
    """The place as a trajectory's provenance says it.

    Args:
      current: of all missions; a gridded file's place and time win.
    """
    place = origin(parameters)
    if current is not None:
        place = current.begins(parameters.duration_s, place)
    return {
        START_LATITUDE: place.latitude_deg,
        START_LONGITUDE: place.longitude_deg,
        START_TIME: str(place.time),
    }


def mission_coordinates(
    signals: Mapping[str, NDArray[np.float32]], place: Mapping[str, float | str]
) -> dict[str, NDArray[Any]]:
    """The coordinates of a flown mission, (samples,), as the store keeps them.

    Args:
      signals: as the store keeps them, (samples,).
      place: of `mission_place`.
    """
    north, east = (signals[f"true_{name}"].astype(float) for name in ("north", "east"))
    return flown_coordinates(sample_times(len(north), SAMPLE_PERIOD), north, east, place)
