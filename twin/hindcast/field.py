"""Field: what a forecast of the current foretells for the dives of a deployment.

A current of the ordinary texts of `--current`, such as a gridded forecast in a file, is averaged
over the way that a dive will make: along its way through the water, carried by the field itself, at
its depths. Where it surfaced is not used.
"""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.geodesy import to_tangent_plane
from twin.hindcast.legs import LoggedLeg
from twin.records.logs import LogStore
from twin.water.current.base import Current
from twin.water.current.origin import Origin

Array = NDArray[np.float64]

POINTS = 25
"""Places along a dive at which the field is read"""


def with_field(logs: LogStore, legs: Sequence[LoggedLeg], current: Current) -> list[LoggedLeg]:
    """Legs with what a field foretells of their mean current.

    Args:
      logs: the store, for the depths.
      legs: of one deployment, in order of time.
      current: its time and place count from the first leg's, unless it has its own.

    Raises:
      CurrentError: the field does not cover the deployment.
    """
    if not legs:
        return []
    first = legs[0]
    moment = datetime.datetime.fromtimestamp(first.leg.start, datetime.UTC)
    origin = Origin(
        latitude_deg=first.begin[0],
        longitude_deg=first.begin[1],
        time=moment.replace(tzinfo=None).isoformat(),
    )
    part = np.linspace(0.0, 1.0, POINTS)
    duration = np.array([one.leg.duration for one in legs])
    since = np.array([one.leg.start for one in legs]) - first.leg.start
    time = since[:, None] + duration[:, None] * part
    begins = np.array([to_tangent_plane(*one.begin, *first.begin) for one in legs]).T
    ways = np.array([one.leg.through_water for one in legs]).T
    depth = np.stack([_depths(logs, one, part) for one in legs])
    found = np.zeros((len(legs), 2))
    for _ in range(2):  # along the way through the water, then along the way that the field makes
        north, east = (
            begin[:, None] + (way + duration * moved)[:, None] * part
            for begin, way, moved in zip(begins, ways, found.T, strict=True)
        )
        found = current.velocity(time, north, east, depth, origin)[..., :2].mean(axis=1)
    return [
        dataclasses.replace(
            one, leg=dataclasses.replace(one.leg, field=(float(mean[0]), float(mean[1])))
        )
        for one, mean in zip(legs, found, strict=True)
    ]


def _depths(logs: LogStore, one: LoggedLeg, part: Array) -> Array:
    """Measured depths [m] at parts of a leg, (part,); gaps are bridged."""
    depth = logs.signal("measured_depth", one.mission).astype(float)
    known = np.flatnonzero(np.isfinite(depth))
    if not known.size:
        return np.zeros(len(part))
    return np.interp(part * one.leg.duration / logs.period, known, np.maximum(depth[known], 0.0))
