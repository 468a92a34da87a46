"""Geodesy: metres between positions on the WGS84 ellipsoid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.water.current.origin import WGS84_FLATTENING, WGS84_SEMI_MAJOR

Array = NDArray[np.float64]


def offset(
    latitude: Array | np.float64, longitude: Array | np.float64, latitude0: float, longitude0: float
) -> tuple[Array, Array]:
    """North and east [m] of positions [degree] from (latitude0, longitude0).

    Metres along the meridian and along the parallel of the mean latitude: what a course by the
    compass adds up to, on a sphere or not. A plane that touches the Earth at the first position
    differs from it by tan(latitude) east^2 / 2 R: 0.6 m for 3 km east at 40 degree.
    """
    e2 = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)
    middle = np.radians(0.5 * (np.asarray(latitude) + latitude0))
    w = 1.0 - e2 * np.sin(middle) ** 2
    meridian = WGS84_SEMI_MAJOR * (1.0 - e2) / w**1.5
    normal = WGS84_SEMI_MAJOR / np.sqrt(w)
    turn = (np.asarray(longitude) - longitude0 + 180.0) % 360.0 - 180.0
    north = np.radians(np.asarray(latitude) - latitude0) * meridian
    east = np.radians(turn) * normal * np.cos(middle)
    return north, east


def turn(x: Array, y: Array, variation_deg: Array | float) -> tuple[Array, Array]:
    """North and east of vectors given as magnetic east `x` and magnetic north `y`.

    A magnetic bearing b is the true bearing b + variation, east variation positive.
    """
    angle = np.radians(variation_deg)
    cosine, sine = np.cos(angle), np.sin(angle)
    return y * cosine - x * sine, x * cosine + y * sine
