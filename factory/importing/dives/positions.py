"""Positions: where a vehicle was at each sample of a row, from what its log holds.

Its way through the water is reckoned from depth rate, pitch and heading; where these say nothing,
the vehicle's own track is taken; where it logged none, it is taken to rest. The misclosure at the
GPS fixes is spread linearly in time (`twin.flight.track`), so that every fix is met. A vehicle that
is taken to rest moves on the straight line between its fixes, and is nowhere outside them.
`twin flight` does better: it knows the vehicle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from factory.importing.dives.dive_current import through_water
from twin.geodesy import position, wrap_longitude
from twin.records.place import rounded_degrees
from twin.water.current.origin import HIGHEST_LATITUDE

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Positions:
    """Where a row was."""

    latitude: Array
    """[degree], (time,), NaN where unknown"""
    longitude: Array
    """[degree], (time,)"""
    method: str
    """One of `twin.records.place.METHODS`"""


def row_positions(
    signals: Mapping[str, Array],
    origin: tuple[float, float] | None,
    period: float,
    *,
    driven: float = 0.0,
) -> Positions:
    """The positions of a row.

    Args:
      signals: of the row, on its grid.
      origin: latitude and longitude [degree] from which its metres count.
      period: [s] of the grid.
      driven: part of the time with the thruster on: then the depth rate says nothing of the speed.
    """
    from twin.flight.fixes import Fixes
    from twin.flight.track import Drift, linear_track, track_velocity

    count = len(signals["measured_gap"])
    nowhere = Positions(
        latitude=np.full(count, np.nan), longitude=np.full(count, np.nan), method="unknown"
    )
    gps = [signals.get(f"measured_gps_{name}") for name in ("north", "east")]
    if origin is None or abs(origin[0]) > HIGHEST_LATITUDE or any(one is None for one in gps):
        return nowhere
    found = np.stack([np.asarray(one) for one in gps], axis=1)
    sample = np.flatnonzero(np.isfinite(found).all(axis=1))
    if not len(sample):
        return nowhere
    fixes = Fixes(sample=sample, position=found[sample])
    velocity, method = through_water(signals, period, driven=driven), "depth_rate_and_pitch"
    if velocity is None:
        own = [signals.get(f"measured_onboard_{name}") for name in ("north", "east")]
        if all(one is not None for one in own):
            track = np.stack([np.asarray(one) for one in own], axis=1)
            velocity, method = track_velocity(track, period, fixes), "onboard_track"
    if velocity is None:
        velocity, method = np.zeros((count, 2)), "straight_line"
    track, _ = linear_track(velocity, period, fixes, Drift(diffusivity=0.0, change=0.0))
    if method == "straight_line":
        track[: sample[0]], track[sample[-1] + 1 :] = np.nan, np.nan
    latitude, longitude = position(track[:, 0], track[:, 1], *origin)
    return Positions(
        latitude=rounded_degrees(latitude),
        longitude=rounded_degrees(wrap_longitude(longitude)),
        method=method,
    )
